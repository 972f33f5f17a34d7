#include "derivatives/medium_record.h"

#include <algorithm>
#include <cmath>

#include "derivatives/form_factor_batch.h"
#include "derivatives/media_path.h"
#include "derivatives/medium_march.h"

namespace fogbank::derivatives {

namespace {

/// What ends nowhere counts as ending this many scene radii away (method.md section 7, "Misses").
constexpr double far_radii = 1e4;
/// Ends nearer than this share of the scene's radius count as that near (method.md section 4.5).
constexpr double least_distance = 1e-4;

using RayPair = std::pair<uint32_t, uint32_t>;
RayPair pair_of(const RayOutline& outline) {
  return {std::min(outline.near, outline.far), std::max(outline.near, outline.far)};
}

}  // namespace

MediumRecord::MediumRecord(const transport::World& the_world, const Vec3f& point,
                           std::span<const MediumRay> the_rays,
                           std::span<const std::array<uint32_t, 3>> the_triangles,
                           std::span<const RayOutline> the_outlines)
    : world(the_world),
      x(point),
      rays(the_rays),
      triangles(the_triangles),
      outlines(the_outlines.begin(), the_outlines.end()),
      medium(the_rays.front().stretches.front().medium) {
  const scene::BoundingSphere& bounds = world.scene().bounds;
  // Of an empty scene, or of a point alone, any size will do.
  const auto size = static_cast<double>(std::max(bounds.radius, glm::length(x - bounds.center)));
  far = far_radii * (size > 0 ? size : 1);
  least = least_distance * static_cast<double>(bounds.radius);
  if (medium != scene::none) {
    sigma_t = Vec3d(world.medium(medium).sigma_t);
    sigma_s = Vec3d(world.medium(medium).sigma_s);
  }
  std::sort(outlines.begin(), outlines.end(),
            [](const RayOutline& a, const RayOutline& b) { return pair_of(a) < pair_of(b); });
}

Vec3d MediumRecord::value_along(size_t ray) const {
  Vec3d sum(0);
  for (const MediumSample& sample : samples_of(ray)) sum += sample.weight * sample.scattered;
  return sum;
}

Vec3d MediumRecord::value() const {
  Vec3d sum(0);
  for (const MediumSample& sample : samples) sum += sample.weight * sample.scattered;
  return sum / static_cast<double>(rays.size());
}

/// Transmittance, over its value, to samples that lie behind boundaries, as the point moves and they don't.
/// For samples in ascending order.
struct MediumRecord::PathBeyond {
  const MediumRecord& record;
  size_t ray;
  MediaPath path{};

  Jet3d transmittance(const MediumSample& sample, int channel) {
    const MediumRay& line = record.rays[ray];
    path.sigma_t = Spectrum(record.sigma_t);
    while (path.boundaries.size() < sample.stretch) {
      const MediumStretch& next = line.stretches[path.boundaries.size() + 1];
      path.boundaries.push_back(
          {line.direction * next.begin, next.normal,
           next.medium == scene::none ? Spectrum(0) : record.world.medium(next.medium).sigma_t});
    }
    const Jet3d jet = path.towards(line.direction * sample.distance).channels[static_cast<size_t>(channel)];
    return jet.value > 0 ? jet * (1 / jet.value) : Jet3d{};
  }
};

ShellMoments<double> MediumRecord::moments(size_t ray, double until, int channel) const {
  ShellMoments<double> moments;
  std::array<double, 3> sums{};  // of w s^-n around the point
  PathBeyond beyond{*this, ray};
  for (const MediumSample& sample : samples_of(ray)) {
    if (sample.distance > until) break;
    if (sample.near) continue;
    const double weight = excess(sample, ray, channel);
    if (sample.stretch > 0) {
      moments.add_sample(weight, sample.distance, beyond.transmittance(sample, channel));
      continue;
    }
    const double inverse = 1 / sample.distance;
    sums[0] += weight;
    sums[1] += weight * inverse;
    sums[2] += weight * inverse * inverse;
  }
  double gradient_0 = sums[0];
  double gradient_1 = sums[1];
  if (!nearby.empty() && nearby[ray].distance > 0) {
    // Around the point what is left of the source is an odd part, which only the gradient sees, and a
    // quadratic one, which only the Hessian sees: over all directions everything else cancels. One look from
    // afar gives both without the noise, inverse to the distance, of samples close by.
    const NearbySample& look = nearby[ray];
    const double inverse = 1 / look.distance;
    const double linear = sigma_s[channel] * excess(look.source, ray, look.distance, channel) * inverse;
    const double quadratic = linear * inverse;
    const NearIntegrals integrals = near_integrals(sigma_t[channel], look.length);
    gradient_0 += linear * integrals.order1;
    gradient_1 += linear * integrals.order0;
    sums[0] += quadratic * integrals.order2;
    sums[1] += quadratic * integrals.order1;
    sums[2] += quadratic * integrals.order0;
  }
  moments.add_homogeneous(rays[ray].direction, sigma_t[channel], gradient_0, gradient_1, sums[0], sums[1],
                          sums[2]);
  return moments;
}

const RayOutline* MediumRecord::outline(uint32_t a, uint32_t b) const {
  const RayPair wanted{std::min(a, b), std::max(a, b)};
  const auto found = std::lower_bound(
      outlines.begin(), outlines.end(), wanted,
      [](const RayOutline& outline, const RayPair& pair) { return pair_of(outline) < pair; });
  return found != outlines.end() && pair_of(*found) == wanted ? &*found : nullptr;
}

const RayOutline* MediumRecord::first_outline(uint32_t a, uint32_t b) const {
  return rays[a].stretches.size() > 1 && rays[b].stretches.size() > 1 ? nullptr : outline(a, b);
}

bool MediumRecord::is_cut(const std::array<uint32_t, 3>& triangle) const {
  const auto& [a, b, c] = triangle;
  return outline(a, b) != nullptr || outline(b, c) != nullptr || outline(c, a) != nullptr;
}

Vec3d MediumRecord::shell_outline(uint32_t ended, uint32_t passing, double distance) const {
  const Vec3d start = rays[ended].direction * end(rays[ended].end);
  if (const RayOutline* found = outline(ended, passing)) return found->near == ended ? found->point : start;
  // Joined ends, with the shell cutting through: where the chord between the two has its distance.
  const Vec3d chord = rays[passing].direction * end(rays[passing].end) - start;
  const double square = glm::dot(chord, chord);
  const double middle = glm::dot(start, chord);
  const double missing = distance * distance - glm::dot(start, start);
  const double root = std::sqrt(std::max(middle * middle + square * missing, 0.0));
  return square > 0 ? start + chord * std::clamp((root - middle) / square, 0.0, 1.0) : start;
}

template <typename Distance, typename Joined>
std::vector<Jet3d> MediumRecord::vertex_forms(const Distance& distance, const Joined& joined,
                                              const RayCounters& counters) const {
  std::vector<BatchVertex<double>> vertices;
  for (uint32_t i = 0; i < rays.size(); ++i) vertices.emplace_back(rays[i].direction, 1 / distance(i));
  std::vector<BatchTriangle> whole;
  for (size_t t = 0; t < triangles.size(); ++t) {
    counters.poll_at(t);
    const auto& [a, b, c] = triangles[t];
    if (joined(a, b) && joined(b, c) && joined(c, a)) whole.push_back({{a, b, c}, BatchTriangle::all});
  }
  std::vector<Jet3d> forms;
  for (const VertexFormFactor<double>& form :
       gather_form_factors<double>(vertices, whole, DerivativeOrder::hessian, counters))
    forms.push_back(form.jet());
  return forms;
}

RadianceJet MediumRecord::linear_source(const Vec3d& vertex) const {
  RadianceJet jet;
  for (size_t c = 0; c < 3; ++c) {
    const auto axis = static_cast<int>(c);
    if (sigma_s[axis] > 0)
      jet.channels[c] = linear_source_jet(sigma_t[axis], vertex, constant[axis], slope[c]) * sigma_s[axis];
  }
  return jet;
}

void MediumRecord::add_linear(RadianceJet& sum, const RayCounters& counters) const {
  if (sigma_s * constant == Vec3d(0) && slope == std::array<Vec3d, 3>{}) return;
  const auto vertex = [this](uint32_t ray) { return rays[ray].direction * first_end(ray); };
  std::vector<RadianceJet> along(rays.size());
  for (uint32_t i = 0; i < along.size(); ++i) {
    counters.poll_at(i);
    along[i] = linear_source(vertex(i));
  }
  /// The mean of what comes along the ways to some points counts for all of `polygon`.
  const auto add = [&](const ShellPolygon<double>& polygon, std::span<const RadianceJet> ways) {
    const Jet3d form = polygon_form_factor(polygon) * (1 / static_cast<double>(ways.size()));
    for (size_t c = 0; c < 3; ++c) {
      Jet3d jet = ways[0].channels[c];
      for (size_t i = 1; i < ways.size(); ++i) jet += ways[i].channels[c];
      sum.channels[c] += jet * form;
    }
  };
  const std::vector<Jet3d> forms =
      vertex_forms([this](uint32_t ray) { return first_end(ray); },
                   [this](uint32_t i, uint32_t j) { return first_outline(i, j) == nullptr; }, counters);
  for (size_t i = 0; i < along.size(); ++i)
    for (size_t c = 0; c < 3; ++c) sum.channels[c] += along[i].channels[c] * forms[i];
  for (size_t t = 0; t < triangles.size(); ++t) {
    counters.poll_at(t);
    const std::array<uint32_t, 3>& triangle = triangles[t];
    std::array<const RayOutline*, 3> cuts;  // of the edge opposite to each corner
    for (size_t i = 0; i < 3; ++i) cuts[i] = first_outline(triangle[(i + 1) % 3], triangle[(i + 2) % 3]);
    if (std::count(cuts.begin(), cuts.end(), nullptr) == 3) continue;
    const std::array<Vec3d, 3> ends{vertex(triangle[0]), vertex(triangle[1]), vertex(triangle[2])};
    // The corner that two outlines cut off from the others.
    const size_t odd = cuts[0] == nullptr ? 0 : (cuts[1] == nullptr ? 1 : 2);
    const std::array<size_t, 2> pair{(odd + 1) % 3, (odd + 2) % 3};
    const RayOutline* left = cuts[pair[1]];
    const RayOutline* right = cuts[pair[0]];
    if (cuts[odd] != nullptr || left == nullptr || right == nullptr ||
        (left->near == triangle[odd]) != (right->near == triangle[odd])) {
      const uint32_t farthest =
          *std::max_element(triangle.begin(), triangle.end(),
                            [this](uint32_t a, uint32_t b) { return first_end(a) < first_end(b); });
      add({{ends[0], ends[1], ends[2], {}}, 3}, std::span(&along[farthest], 1));
      continue;
    }
    // The outline as seen on the nearer surface and on what lies behind it; in between a strip without
    // area, whose weight is the far one (method.md section 6.2).
    const bool odd_near = left->near == triangle[odd];
    const auto side = [&](bool near) {
      return std::array{near ? left->point : left->behind, near ? right->point : right->behind};
    };
    const auto [odd_left, odd_right] = side(odd_near);
    const auto [pair_left, pair_right] = side(!odd_near);
    const std::array far_ways{linear_source(left->behind), linear_source(right->behind)};
    const std::array near_ways{linear_source(left->point), linear_source(right->point)};
    const auto& [left_odd, right_odd] = odd_near ? near_ways : far_ways;
    const auto& [left_pair, right_pair] = odd_near ? far_ways : near_ways;
    add({{ends[odd], odd_left, odd_right, {}}, 3}, std::array{along[triangle[odd]], left_odd, right_odd});
    add({{pair_left, ends[pair[0]], ends[pair[1]], pair_right}, 4},
        std::array{left_pair, along[triangle[pair[0]]], along[triangle[pair[1]]], right_pair});
    add({{odd_left, pair_left, pair_right, odd_right}, 4}, far_ways);
  }
}

void MediumRecord::add_cut_shells(const std::array<uint32_t, 3>& triangle,
                                  const std::array<Vec3d, 3>& directions,
                                  std::span<RadianceJet> along) const {
  const std::array<double, 3> ends{end(rays[triangle[0]].end), end(rays[triangle[1]].end),
                                   end(rays[triangle[2]].end)};
  const double nearest = std::min({ends[0], ends[1], ends[2]});
  for (const uint32_t ray : triangle) {
    PathBeyond beyond{*this, ray};
    for (const MediumSample& sample : samples_of(ray)) {
      if (sample.near || sample.distance <= nearest) continue;
      const double alive = static_cast<double>(
          std::count_if(ends.begin(), ends.end(), [&](double end) { return end > sample.distance; }));
      const Jet3d form = polygon_form_factor(
          lit_polygon(directions, ends, sample.distance, [&](size_t ended, size_t passing) {
            return shell_outline(triangle[ended], triangle[passing], sample.distance);
          }));
      const Jet3d distance = distance_jet(rays[ray].direction * sample.distance);
      for (int channel = 0; channel < 3; ++channel) {
        const double sigma = sigma_t[channel];
        const Jet3d transmittance = sample.stretch == 0 ? chain(distance, 1.0, -sigma, sigma * sigma)
                                                        : beyond.transmittance(sample, channel);
        along[ray].channels[static_cast<size_t>(channel)] +=
            transmittance * form * (excess(sample, ray, channel) / std::max(alive, 1.0));
      }
    }
  }
}

RadianceJet MediumRecord::derivatives(DerivativeVariance& variance, const RayCounters& counters) const {
  RadianceJet sum;
  add_linear(sum, counters);
  std::vector<RadianceJet> along(rays.size());
  // Form factors of the unit sphere's triangles: those that nothing cuts are shared out to their corners.
  const std::vector<Jet3d> cells =
      vertex_forms([](uint32_t) { return 1.0; },
                   [this](uint32_t i, uint32_t j) { return outline(i, j) == nullptr; }, counters);
  for (size_t t = 0; t < triangles.size(); ++t) {
    counters.poll_at(t);
    const std::array<uint32_t, 3>& triangle = triangles[t];
    if (!is_cut(triangle)) continue;
    counters.poll();
    const std::array<Vec3d, 3> directions{rays[triangle[0]].direction, rays[triangle[1]].direction,
                                          rays[triangle[2]].direction};
    const Jet3d third = triangle_form_factor_jet(RelativeTriangle<double>::from_relative(
                            directions[0], directions[1], directions[2])) *
                        (1.0 / 3);
    const double nearest =
        std::min({end(rays[triangle[0]].end), end(rays[triangle[1]].end), end(rays[triangle[2]].end)});
    for (const uint32_t ray : triangle) {
      for (int c = 0; c < 3; ++c)
        along[ray].channels[static_cast<size_t>(c)] +=
            shell_jet(third, rays[ray].direction, moments(ray, nearest, c));
    }
    add_cut_shells(triangle, directions, along);
  }
  for (size_t i = 0; i < rays.size(); ++i) {
    counters.poll_at(i);
    for (int c = 0; c < 3; ++c)
      along[i].channels[static_cast<size_t>(c)] += shell_jet(cells[i], rays[i].direction, moments(i, far, c));
    sum += along[i];
  }
  // Neighbours in the order are neighbours in direction.
  for (size_t i = 0; i + 1 < rays.size(); i += 2) {
    const Jet3d difference = along[i].luminance() + along[i + 1].luminance() * -1;
    variance.gradient += glm::dot(difference.gradient, difference.gradient);
    const double norm = difference.hessian.norm();
    variance.hessian += norm * norm;
  }
  return sum;
}

}  // namespace fogbank::derivatives
