#include "derivatives/grid_assembly.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "derivatives/light_triangles.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

namespace {

constexpr double four_pi = 4 * std::numbers::pi;

class Assembly {
 public:
  Assembly(const SeenGrid& seen, const EstimatorSettings& settings, RadianceJet& sum)
      : seen_(seen),
        grid_(seen.grid()),
        settings_(settings),
        triangles_(grid_, seen.sigma_t(), settings.derivatives),
        sum_(sum),
        vertices_(grid_.vertices.size()) {
    for (uint32_t i = 0; i < vertices_.size(); ++i) {
      seen.counters().poll_at(i);
      if (seen.visible(i)) vertices_[i] = {grid_.vertices[i], seen.transmittance(i, grid_.vertices[i])};
    }
  }

  bool derivatives() const { return settings_.derivatives != DerivativeOrder::value; }
  bool hessian() const { return settings_.derivatives == DerivativeOrder::hessian; }
  const LightVertex& vertex(uint32_t index) const { return vertices_[index]; }
  int visible_corners(const LightGrid::Triangle& triangle) const {
    int count = 0;
    for (const uint32_t index : triangle.vertices) count += seen_.visible(index) ? 1 : 0;
    return count;
  }

  void add_visible(const LightGrid::Triangle& triangle) const {
    const auto& [a, b, c] = triangle.vertices;
    triangles_.add_triangle(vertices_[a], vertices_[b], vertices_[c], in_one_medium(triangle),
                            triangle.radiance, sum_);
  }
  void add_cut(const LightGrid::Triangle& triangle, const std::array<int32_t, 3>& edge_crossings,
               const std::vector<OutlinePoint>& crossings) const;
  /// The farthest rule on a triangle with visible and blocked vertices. Returns the value of the mean rule.
  Vec3d add_mixed(const LightGrid::Triangle& triangle, double far_distance) const;
  void add_round_edges() const;

 private:
  bool in_one_medium(const LightGrid::Triangle& triangle) const {
    return std::all_of(triangle.vertices.begin(), triangle.vertices.end(),
                       [&](uint32_t index) { return !seen_.visible(index) || seen_.in_one_medium(index); });
  }
  LightVertex on(const OutlinePoint& crossing) const {
    return {crossing.far, seen_.transmittance(crossing.visible_vertex, crossing.far)};
  }

  /// The strip between an outline on the light (from `first` to `second`, the visible part on the left as
  /// directions go counter-clockwise) and the same outline on the blocker. Its radial edges have no terms.
  void add_strip(const LightVertex& first, const LightVertex& second, const OutlinePoint& near_first,
                 const OutlinePoint& near_second, const LightGrid::Triangle& triangle) const;
  /// Section 6.4 (a), for a slope of the weight in any direction: the outline moves over the light by
  /// v = -kappa dx (across the line of sight, radians), so that the strip's mean weight changes by
  /// v . slope / 2. With the slope across the outline alone, as in section 6.4, it is the form given there.
  void add_sliding(const LightVertex& first, const LightVertex& second, double kappa, const Jet3d& strip,
                   const LightGrid::Triangle& triangle) const;
  /// Section 6.4 (b): the outline of a blocker and the border of the light, `along_border` in the direction
  /// in which the visible part's border is traversed; `arriving` on the light's border.
  void add_corner(const LightVertex& corner, const OutlinePoint& crossing, const Vec3d& along_border,
                  const Vec3d& along_silhouette, bool arriving, const Spectrum& radiance) const;

  const SeenGrid& seen_;
  const LightGrid& grid_;
  const EstimatorSettings& settings_;
  LightTriangles triangles_;
  RadianceJet& sum_;
  std::vector<LightVertex> vertices_;
};

void Assembly::add_strip(const LightVertex& first, const LightVertex& second, const OutlinePoint& near_first,
                         const OutlinePoint& near_second, const LightGrid::Triangle& triangle) const {
  const auto edge = [](const Vec3d& a, const Vec3d& b) {
    return edge_term(ScaledVector<double, 3>(a), ScaledVector<double, 3>(b), b - a);
  };
  Jet3d strip = edge(near_first.near, near_second.near);
  if (!grid_.at_infinity) strip -= edge(first.position, second.position);
  LightTriangles::add(strip, mean_of(first.transmittance, second.transmittance), triangle.radiance, sum_);
  if (!settings_.sliding || !hessian() || grid_.at_infinity) return;
  const double kappa =
      2 / glm::length(near_first.near + near_second.near) - 2 / glm::length(first.position + second.position);
  add_sliding(first, second, kappa, strip, triangle);
}

void Assembly::add_sliding(const LightVertex& first, const LightVertex& second, double kappa,
                           const Jet3d& strip, const LightGrid::Triangle& triangle) const {
  const Vec3d middle = (first.position + second.position) * 0.5;
  const double distance = glm::length(middle);
  const Vec3d u = middle / distance;
  const auto& [a, b, c] = triangle.vertices;
  const Vec3d normal =
      glm::cross(grid_.vertices[b] - grid_.vertices[a], grid_.vertices[c] - grid_.vertices[a]);
  const double facing = glm::dot(normal, u);
  if (facing == 0) return;
  // Change of the distance to the light's plane per radian, as a vector across the line of sight.
  const Vec3d slide = (normal - u * facing) * (-distance / facing);
  const Symmetric3d turn = Symmetric3d::outer_sum(strip.gradient, slide) * (-0.5 * kappa);
  const RadianceJet transmittance = mean_of(first.transmittance, second.transmittance);
  for (size_t channel = 0; channel < 3; ++channel) {
    const double per_distance = -glm::dot(transmittance.channels[channel].gradient, u);
    sum_.channels[channel].hessian +=
        turn * (per_distance * static_cast<double>(triangle.radiance[static_cast<int>(channel)]));
  }
}

void Assembly::add_corner(const LightVertex& corner, const OutlinePoint& crossing, const Vec3d& along_border,
                          const Vec3d& along_silhouette, bool arriving, const Spectrum& radiance) const {
  const double far = glm::length(corner.position);
  const double near = glm::length(crossing.near);
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
                       const std::vector<OutlinePoint>& crossings) const {
  // The odd vertex is visible among blocked ones or the reverse; its two edges are crossed.
  size_t odd = 0;
  for (size_t i = 0; i < 3; ++i) {
    if (edge_crossings[i] >= 0 && edge_crossings[(i + 2) % 3] >= 0) odd = i;
  }
  const uint32_t o = triangle.vertices[odd];
  const uint32_t p = triangle.vertices[(odd + 1) % 3];
  const uint32_t q = triangle.vertices[(odd + 2) % 3];
  const OutlinePoint& on_op = crossings[static_cast<size_t>(edge_crossings[odd])];
  const OutlinePoint& on_oq = crossings[static_cast<size_t>(edge_crossings[(odd + 2) % 3])];
  const LightVertex f_op = on(on_op);
  const LightVertex f_oq = on(on_oq);
  const bool uniform = in_one_medium(triangle);
  const bool odd_visible = seen_.visible(o);
  if (odd_visible) {
    triangles_.add_triangle(vertices_[o], f_op, f_oq, uniform, triangle.radiance, sum_);
  } else {
    triangles_.add_triangle(f_op, vertices_[p], vertices_[q], uniform, triangle.radiance, sum_);
    triangles_.add_triangle(f_op, vertices_[q], f_oq, uniform, triangle.radiance, sum_);
  }
  if (!derivatives() || !on_op.has_blocker || !on_oq.has_blocker) return;
  const LightVertex& first = odd_visible ? f_op : f_oq;
  const LightVertex& second = odd_visible ? f_oq : f_op;
  const OutlinePoint& near_first = odd_visible ? on_op : on_oq;
  const OutlinePoint& near_second = odd_visible ? on_oq : on_op;
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

Vec3d Assembly::add_mixed(const LightGrid::Triangle& triangle, double far_distance) const {
  std::array<Vec3d, 3> positions;
  Vec3d transmittance(0);
  uint32_t farthest = triangle.vertices[0];
  double farthest_distance = -1;
  for (size_t i = 0; i < 3; ++i) {
    const uint32_t index = triangle.vertices[i];
    const bool visible = seen_.visible(index);
    double distance = grid_.at_infinity ? far_distance : glm::length(grid_.vertices[index]);
    if (!visible) distance = std::min(distance, seen_.blocker_distance(index));
    positions[i] = glm::normalize(grid_.vertices[index]) * distance;
    for (int c = 0; visible && c < 3; ++c)
      transmittance[c] += vertices_[index].transmittance.channels[static_cast<size_t>(c)].value;
    if (distance > farthest_distance || (distance == farthest_distance && visible)) {
      farthest_distance = distance;
      farthest = index;
    }
  }
  if (derivatives() && seen_.visible(farthest)) {
    const auto slanted = RelativeTriangle<double>::from_relative(positions[0], positions[1], positions[2]);
    LightTriangles::add(triangle_form_factor_jet(slanted), vertices_[farthest].transmittance,
                        triangle.radiance, sum_);
  }
  const auto& [a, b, c] = triangle.vertices;
  const double form_factor =
      triangles_.form_factor(grid_.vertices[a], grid_.vertices[b], grid_.vertices[c]).value;
  return transmittance * Vec3d(triangle.radiance) * (form_factor / 3);
}

void Assembly::add_round_edges() const {
  for (const LightGrid::RoundEdge& edge : grid_.round_edges) {
    for (const uint32_t index : edge.vertices) {
      if (!seen_.visible(index)) continue;
      const Symmetric3d bend = Symmetric3d::outer(edge.outward) * (0.5 * edge.bend / four_pi);
      for (size_t c = 0; c < 3; ++c)
        sum_.channels[c].hessian +=
            bend * (vertices_[index].transmittance.channels[c].value * edge.radiance[static_cast<int>(c)]);
    }
  }
}

}  // namespace

void add_cut_grid(const SeenGrid& seen, const Silhouettes& silhouettes, const EstimatorSettings& settings,
                  RadianceJet& sum) {
  const Assembly assembly(seen, settings, sum);
  for (size_t t = 0; t < seen.grid().triangles.size(); ++t) {
    seen.counters().poll_at(t);
    const LightGrid::Triangle& triangle = seen.grid().triangles[t];
    const int visible = assembly.visible_corners(triangle);
    if (visible == 3) assembly.add_visible(triangle);
    if (visible == 1 || visible == 2)
      assembly.add_cut(triangle, silhouettes.of_triangle[t], silhouettes.crossings);
  }
  if (assembly.hessian()) assembly.add_round_edges();
}

void add_plain_grid(const SeenGrid& seen, double far_distance, const EstimatorSettings& settings,
                    RadianceJet& sum) {
  RadianceJet plain;
  const Assembly assembly(seen, settings, plain);
  for (size_t t = 0; t < seen.grid().triangles.size(); ++t) {
    seen.counters().poll_at(t);
    const LightGrid::Triangle& triangle = seen.grid().triangles[t];
    if (assembly.visible_corners(triangle) == 3) assembly.add_visible(triangle);
  }
  Vec3d mean(plain.channels[0].value, plain.channels[1].value, plain.channels[2].value);
  for (size_t t = 0; t < seen.grid().triangles.size(); ++t) {
    seen.counters().poll_at(t);
    const LightGrid::Triangle& triangle = seen.grid().triangles[t];
    const int visible = assembly.visible_corners(triangle);
    if (visible == 1 || visible == 2) mean += assembly.add_mixed(triangle, far_distance);
  }
  if (assembly.hessian()) assembly.add_round_edges();
  for (int c = 0; c < 3; ++c) plain.channels[static_cast<size_t>(c)].value = mean[c];
  sum += plain;
}

}  // namespace fogbank::derivatives
