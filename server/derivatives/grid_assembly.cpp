#include "derivatives/grid_assembly.h"

#include <algorithm>

#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

namespace {

/// Visible triangles wider than this are split for the transmittance (ratio-records.md section 2.2).
constexpr double widest_cell = 0.2;
/// ... as often as this at the most: a cell seen under half the sphere takes 8 halvings of its edges.
constexpr int most_splits = 16;
/// Bound on the correction of the derivatives' scale: beyond it the farthest rule's sum is all noise.
constexpr double largest_ratio = 4;

constexpr double four_pi = 4 * std::numbers::pi;

RadianceJet mean_of(const RadianceJet& a, const RadianceJet& b) {
  RadianceJet sum = a;
  sum += b;
  sum *= 0.5;
  return sum;
}

RadianceJet mean_of(const RadianceJet& a, const RadianceJet& b, const RadianceJet& c) {
  RadianceJet sum = a;
  sum += b;
  sum += c;
  sum *= 1.0 / 3;
  return sum;
}

/// A point of the light with the transmittance towards it.
struct Vertex {
  Vec3d position;
  RadianceJet transmittance;
};

class Assembly {
 public:
  Assembly(const SeenGrid& seen, const EstimatorSettings& settings, RadianceJet& sum)
      : grid_(seen.grid), seen_(seen), settings_(settings), sum_(sum) {
    transmittances_.resize(grid_.vertices.size());
    for (size_t i = 0; i < grid_.vertices.size(); ++i) {
      if (seen.visible[i] != 0) transmittances_[i] = towards(seen.paths[i], grid_.vertices[i]);
    }
  }

  bool derivatives() const { return settings_.derivatives != DerivativeOrder::value; }
  bool hessian() const { return settings_.derivatives == DerivativeOrder::hessian; }

  RadianceJet towards(const MediaPath& path, const Vec3d& target) const {
    return grid_.at_infinity ? path.towards_infinity(target) : path.towards(target);
  }
  Vertex vertex(uint32_t index) const { return {grid_.vertices[index], transmittances_[index]}; }
  const RadianceJet& transmittance(uint32_t index) const { return transmittances_[index]; }
  Vertex on(const Crossing& crossing) const {
    return {crossing.far, towards(seen_.paths[crossing.visible_vertex], crossing.far)};
  }

  /// Form factor of a triangle on the light. Lights at infinity have no parallax.
  Jet3d form_factor(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
    const auto triangle = RelativeTriangle<double>::from_relative(a, b, c);
    if (grid_.at_infinity || !derivatives()) return Jet3d::constant(triangle_form_factor(triangle));
    return triangle_form_factor_jet(triangle);
  }

  void add(const Jet3d& form_factor, const RadianceJet& transmittance, const Spectrum& radiance) const {
    for (size_t c = 0; c < 3; ++c) {
      const double weight = radiance[static_cast<int>(c)];
      if (weight != 0) sum_.channels[c] += (form_factor * transmittance.channels[c]) * weight;
    }
  }

  /// A wholly visible triangle; `path` leads to one of its points.
  void add_visible(const Vertex& a, const Vertex& b, const Vertex& c, const MediaPath& path, bool same_path,
                   const Spectrum& radiance, int splits = 0) const {
    if (same_path && splits < most_splits) {
      const auto split = [&](const Vertex& from, const Vertex& to, const Vertex& opposite) {
        Vertex middle;
        middle.position = (from.position + to.position) * 0.5;
        middle.transmittance = towards(path, middle.position);
        add_visible(from, middle, opposite, path, true, radiance, splits + 1);
        add_visible(middle, to, opposite, path, true, radiance, splits + 1);
      };
      const double ab = cosine(a, b);
      const double bc = cosine(b, c);
      const double ca = cosine(c, a);
      const double least = std::min({ab, bc, ca});
      if (least < std::cos(widest_cell)) {
        if (least == ab) return split(a, b, c);
        if (least == bc) return split(b, c, a);
        return split(c, a, b);
      }
    }
    add(form_factor(a.position, b.position, c.position),
        mean_of(a.transmittance, b.transmittance, c.transmittance), radiance);
  }

  /// A triangle of grid vertices, all visible.
  void add_visible(const LightGrid::Triangle& triangle) const {
    const auto& [a, b, c] = triangle.vertices;
    const MediaPath& path = seen_.paths[a];
    add_visible(vertex(a), vertex(b), vertex(c), path, splittable(triangle), triangle.radiance);
  }

  /// Whether the transmittance varies over the triangle and one path serves all of it.
  bool splittable(const LightGrid::Triangle& triangle) const {
    if (grid_.at_infinity) return false;
    bool uniform = true;
    bool clear = true;
    for (const uint32_t index : triangle.vertices) {
      if (seen_.visible[index] == 0) continue;
      uniform = uniform && seen_.paths[index].uniform();
      clear = clear && is_black(seen_.paths[index].sigma_t);
    }
    return uniform && !clear;
  }

  void add_cut(const LightGrid::Triangle& triangle, const std::array<int32_t, 3>& edge_crossings,
               const std::vector<Crossing>& crossings) const;
  void add_round_edge(const LightGrid::RoundEdge& edge) const;

 private:
  static double cosine(const Vertex& a, const Vertex& b) {
    const double lengths = glm::length(a.position) * glm::length(b.position);
    return lengths > 0 ? glm::dot(a.position, b.position) / lengths : 1;
  }

  /// The strip between an outline on the light (from `first` to `second`, the visible part on the left as
  /// directions go counter-clockwise) and the same outline on the blocker. Its radial edges have no terms.
  void add_strip(const Vertex& first, const Vertex& second, const Crossing& near_first,
                 const Crossing& near_second, const LightGrid::Triangle& triangle) const;
  /// Section 6.4 (a).
  void add_sliding(const Vertex& first, const Vertex& second, const Jet3d& strip,
                   const LightGrid::Triangle& triangle) const;
  /// Section 6.4 (b): the outline of a blocker and the border of the light, `along_border` in the direction
  /// in which the visible part's border is traversed; `arriving` on the light's border.
  void add_corner(const Vertex& corner, const Crossing& crossing, const Vec3d& along_border,
                  const Vec3d& along_silhouette, bool arriving, const Spectrum& radiance) const;

  const LightGrid& grid_;
  const SeenGrid& seen_;
  const EstimatorSettings& settings_;
  RadianceJet& sum_;
  std::vector<RadianceJet> transmittances_;
};

void Assembly::add_strip(const Vertex& first, const Vertex& second, const Crossing& near_first,
                         const Crossing& near_second, const LightGrid::Triangle& triangle) const {
  const auto edge = [](const Vec3d& a, const Vec3d& b) {
    return edge_term(ScaledVector<double, 3>(a), ScaledVector<double, 3>(b), b - a);
  };
  Jet3d strip = edge(near_first.near, near_second.near);
  if (!grid_.at_infinity) strip -= edge(first.position, second.position);
  add(strip, mean_of(first.transmittance, second.transmittance), triangle.radiance);
  if (settings_.sliding && hessian() && !grid_.at_infinity) add_sliding(first, second, strip, triangle);
}

void Assembly::add_sliding(const Vertex& first, const Vertex& second, const Jet3d& strip,
                           const LightGrid::Triangle& triangle) const {
  const Vec3d middle = (first.position + second.position) * 0.5;
  const Vec3d u = glm::normalize(middle);
  const Vec3d across = glm::cross(u, second.position - first.position);
  const double length = glm::length(across);
  const double angle = length / glm::length(middle);
  const auto& [a, b, c] = triangle.vertices;
  const Vec3d normal =
      glm::cross(grid_.vertices[b] - grid_.vertices[a], grid_.vertices[c] - grid_.vertices[a]);
  const double facing = glm::dot(normal, u);
  if (!(angle > 0) || facing == 0) return;
  // Distance on the light's plane changes by -d (n.m)/(n.u) per radian towards m.
  const Vec3d towards_light = across / length;
  const double slide = -glm::length(middle) * glm::dot(normal, towards_light) / facing;
  const Symmetric3d outer = Symmetric3d::outer(strip.gradient);
  const RadianceJet transmittance = mean_of(first.transmittance, second.transmittance);
  for (size_t channel = 0; channel < 3; ++channel) {
    // gradT = -T' u along the line of sight.
    const double per_distance = -glm::dot(transmittance.channels[channel].gradient, u);
    const double slope = per_distance * slide * triangle.radiance[static_cast<int>(channel)];
    sum_.channels[channel].hessian += outer * (-four_pi * slope / angle);
  }
}

void Assembly::add_corner(const Vertex& corner, const Crossing& crossing, const Vec3d& along_border,
                          const Vec3d& along_silhouette, bool arriving, const Spectrum& radiance) const {
  const double far = glm::length(corner.position);
  const double near = glm::length(crossing.near);
  if (!(near > 0)) return;
  const double kappa = 1 / near - (grid_.at_infinity ? 0 : 1 / far);
  const Vec3d u = corner.position / far;
  // a(e) of section 6.4 is the edge turned clockwise, e x u.
  Vec3d border = glm::cross(along_border, u);
  Vec3d silhouette = glm::cross(along_silhouette, u);
  border /= glm::length(border);
  silhouette /= glm::length(silhouette);
  const double sine = glm::dot(glm::cross(border, silhouette), u);
  // Grazing corners have no second derivative; bounded, as their share of all configurations is.
  constexpr double least_sine = 0.02;
  if (!(std::fabs(sine) > least_sine)) return;
  const double sign = arriving ? -1 : 1;
  const Symmetric3d term =
      Symmetric3d::outer_sum(border, silhouette) * (sign * 0.5 * kappa * kappa / (four_pi * sine));
  for (size_t channel = 0; channel < 3; ++channel)
    sum_.channels[channel].hessian +=
        term * (corner.transmittance.channels[channel].value * radiance[static_cast<int>(channel)]);
}

void Assembly::add_cut(const LightGrid::Triangle& triangle, const std::array<int32_t, 3>& edge_crossings,
                       const std::vector<Crossing>& crossings) const {
  // The odd vertex is visible among blocked ones or the reverse; its two edges are crossed.
  size_t odd = 0;
  for (size_t i = 0; i < 3; ++i) {
    if (edge_crossings[i] >= 0 && edge_crossings[(i + 2) % 3] >= 0) odd = i;
  }
  const uint32_t o = triangle.vertices[odd];
  const uint32_t p = triangle.vertices[(odd + 1) % 3];
  const uint32_t q = triangle.vertices[(odd + 2) % 3];
  const Crossing& on_op = crossings[static_cast<size_t>(edge_crossings[odd])];
  const Crossing& on_oq = crossings[static_cast<size_t>(edge_crossings[(odd + 2) % 3])];
  const Vertex f_op = on(on_op);
  const Vertex f_oq = on(on_oq);
  const bool split = splittable(triangle);
  const bool odd_visible = seen_.visible[o] != 0;
  if (odd_visible) {
    add_visible(vertex(o), f_op, f_oq, seen_.paths[o], split, triangle.radiance);
  } else {
    add_visible(f_op, vertex(p), vertex(q), seen_.paths[p], split, triangle.radiance);
    add_visible(f_op, vertex(q), f_oq, seen_.paths[q], split, triangle.radiance);
  }
  if (!derivatives()) return;
  const Vertex& first = odd_visible ? f_op : f_oq;
  const Vertex& second = odd_visible ? f_oq : f_op;
  const Crossing& near_first = odd_visible ? on_op : on_oq;
  const Crossing& near_second = odd_visible ? on_oq : on_op;
  add_strip(first, second, near_first, near_second, triangle);
  if (!settings_.corners || !hessian()) return;
  const Vec3d along_silhouette = second.position - first.position;
  const Vec3d op = grid_.vertices[p] - grid_.vertices[o];
  const Vec3d qo = grid_.vertices[o] - grid_.vertices[q];
  if (near_first.on_border)
    add_corner(first, near_first, odd_visible ? op : qo, along_silhouette, true, triangle.radiance);
  if (near_second.on_border)
    add_corner(second, near_second, odd_visible ? qo : op, along_silhouette, false, triangle.radiance);
}

void Assembly::add_round_edge(const LightGrid::RoundEdge& edge) const {
  double share = 0;
  RadianceJet weight;
  for (const uint32_t index : edge.vertices) {
    if (seen_.visible[index] == 0) continue;
    share += 0.5;
    weight += transmittances_[index];
  }
  if (share == 0) return;
  const Symmetric3d bend = Symmetric3d::outer(edge.outward) * (0.5 * edge.bend / four_pi);
  for (size_t c = 0; c < 3; ++c)
    sum_.channels[c].hessian += bend * (weight.channels[c].value * edge.radiance[static_cast<int>(c)]);
}

}  // namespace

void add_cut_grid(const SeenGrid& seen, const Silhouettes& silhouettes, const EstimatorSettings& settings,
                  RadianceJet& sum) {
  const Assembly assembly(seen, settings, sum);
  for (size_t t = 0; t < seen.grid.triangles.size(); ++t) {
    const LightGrid::Triangle& triangle = seen.grid.triangles[t];
    int visible = 0;
    for (const uint32_t index : triangle.vertices) visible += seen.visible[index];
    if (visible == 3) assembly.add_visible(triangle);
    if (visible == 1 || visible == 2)
      assembly.add_cut(triangle, silhouettes.of_triangle[t], silhouettes.crossings);
  }
  if (!assembly.hessian()) return;
  for (const LightGrid::RoundEdge& edge : seen.grid.round_edges) assembly.add_round_edge(edge);
}

void add_plain_grid(const SeenGrid& seen, const std::vector<double>& blockers, double far_distance,
                    const EstimatorSettings& settings, RadianceJet& sum) {
  const LightGrid& grid = seen.grid;
  RadianceJet plain;  // the farthest rule's sum
  const Assembly assembly(seen, settings, plain);
  std::array<double, 3> mean{};
  for (const LightGrid::Triangle& triangle : grid.triangles) {
    size_t visible = 0;
    for (const uint32_t index : triangle.vertices) visible += seen.visible[index];
    if (visible == 0) continue;
    RadianceJet before = plain;
    if (visible == 3) {
      assembly.add_visible(triangle);
      for (size_t c = 0; c < 3; ++c) mean[c] += plain.channels[c].value - before.channels[c].value;
      continue;
    }
    std::array<Vec3d, 3> positions;
    RadianceJet transmittance;
    uint32_t farthest = triangle.vertices[0];
    double farthest_distance = -1;
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t index = triangle.vertices[i];
      const bool is_visible = seen.visible[index] != 0;
      double distance = grid.at_infinity ? far_distance : glm::length(grid.vertices[index]);
      if (is_visible) {
        transmittance += assembly.transmittance(index);
      } else {
        distance = std::min(distance, blockers[index]);
      }
      positions[i] = glm::normalize(grid.vertices[index]) * distance;
      if (distance > farthest_distance || (distance == farthest_distance && is_visible)) {
        farthest_distance = distance;
        farthest = index;
      }
    }
    const auto& [a, b, c] = triangle.vertices;
    const double third = assembly.form_factor(grid.vertices[a], grid.vertices[b], grid.vertices[c]).value / 3;
    for (size_t channel = 0; channel < 3; ++channel)
      mean[channel] += third * transmittance.channels[channel].value *
                       static_cast<double>(triangle.radiance[static_cast<int>(channel)]);
    if (assembly.derivatives() && seen.visible[farthest] != 0)
      assembly.add(triangle_form_factor_jet(
                       RelativeTriangle<double>::from_relative(positions[0], positions[1], positions[2])),
                   assembly.transmittance(farthest), triangle.radiance);
  }
  if (assembly.hessian()) {
    for (const LightGrid::RoundEdge& edge : grid.round_edges) assembly.add_round_edge(edge);
  }
  for (size_t c = 0; c < 3; ++c) {
    Jet3d& channel = plain.channels[c];
    if (channel.value > 0) channel *= std::min(mean[c] / channel.value, largest_ratio);
    channel.value = mean[c];
  }
  sum += plain;
}

}  // namespace fogbank::derivatives
