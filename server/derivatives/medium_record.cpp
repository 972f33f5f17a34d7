#include "derivatives/medium_record.h"

#include <algorithm>
#include <cmath>

#include "derivatives/media_path.h"
#include "derivatives/medium_march.h"

namespace fogbank::derivatives {

namespace {

/// What ends nowhere counts as ending this many scene radii away (method.md section 7, "Misses").
constexpr double far_radii = 1e4;
/// Ends nearer than this share of the scene's radius count as that near (method.md section 4.5).
constexpr double least_distance = 1e-4;
/// Ends of first stretches that are no surfaces.
constexpr uint32_t medium_boundary = MediumRay::no_surface - 1;

bool is_grey(const Vec3d& sigma_t) { return sigma_t.x == sigma_t.y && sigma_t.y == sigma_t.z; }

bool same(uint32_t a, uint32_t b, uint32_t c) { return a == b && b == c; }

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

Vec3d MediumRecord::value() const {
  Vec3d sum(0);
  for (const MediumSample& sample : samples) sum += sample.weight * sample.source;
  return sum / static_cast<double>(rays.size());
}

uint32_t MediumRecord::first_surface(size_t ray) const {
  return rays[ray].stretches.size() > 1 ? medium_boundary : rays[ray].surface;
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
    const double weight = excess(sample, channel);
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
  if (!nearby.empty()) {
    // Around the point the source is a linear part, which only the gradient sees, and a quadratic one, which
    // only the Hessian sees: over all directions everything else cancels. One look from afar gives both
    // without the noise, inverse to the distance, of samples close by.
    const NearbySample& look = nearby[ray];
    const double inverse = 1 / look.distance;
    const double linear = sigma_s[channel] * (look.source[channel] - constant[channel]) * inverse;
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

Vec3d MediumRecord::shell_outline(uint32_t ended, uint32_t passing, double distance) const {
  const Vec3d start = rays[ended].direction * end(rays[ended].end);
  if (rays[ended].surface == rays[passing].surface) {
    // One surface that the shell cuts through: where the chord between the two ends has its distance.
    const Vec3d chord = rays[passing].direction * end(rays[passing].end) - start;
    const double square = glm::dot(chord, chord);
    const double middle = glm::dot(start, chord);
    const double missing = distance * distance - glm::dot(start, start);
    const double root = std::sqrt(std::max(middle * middle + square * missing, 0.0));
    return square > 0 ? start + chord * std::clamp((root - middle) / square, 0.0, 1.0) : start;
  }
  const RayOutline* found = outline(ended, passing);
  return found != nullptr && found->near == ended ? found->point : start;
}

void MediumRecord::add_constant(RadianceJet& sum) const {
  const Vec3d strength = sigma_s * constant;
  if (strength == Vec3d(0)) return;
  const bool grey = is_grey(sigma_t);
  const auto vertex = [this](uint32_t ray) { return rays[ray].direction * first_end(ray); };
  const auto add = [&](const ShellPolygon<double>& polygon, std::span<const Vec3d> ends) {
    const Jet3d form = polygon_form_factor(polygon);
    Jet3d jet;
    for (int channel = 0; channel < 3; ++channel) {
      if (channel == 0 || !grey) {
        jet = {};
        for (const Vec3d& end : ends) jet += constant_source_jet(sigma_t[channel], end);
        jet = jet * form * (1 / static_cast<double>(ends.size()));
      }
      sum.channels[static_cast<size_t>(channel)] += jet * strength[channel];
    }
  };
  for (const std::array<uint32_t, 3>& triangle : triangles) {
    const std::array<Vec3d, 3> ends{vertex(triangle[0]), vertex(triangle[1]), vertex(triangle[2])};
    const ShellPolygon<double> whole{{ends[0], ends[1], ends[2], {}}, 3};
    const std::array<uint32_t, 3> surfaces{first_surface(triangle[0]), first_surface(triangle[1]),
                                           first_surface(triangle[2])};
    if (same(surfaces[0], surfaces[1], surfaces[2])) {
      add(whole, ends);
      continue;
    }
    // The corner that differs from the two others, and the outlines on its two sides.
    const size_t odd = surfaces[1] == surfaces[2] ? 0 : (surfaces[2] == surfaces[0] ? 1 : 2);
    const std::array<size_t, 2> pair{(odd + 1) % 3, (odd + 2) % 3};
    const RayOutline* left = outline(triangle[odd], triangle[pair[0]]);
    const RayOutline* right = outline(triangle[odd], triangle[pair[1]]);
    if (left == nullptr || right == nullptr || surfaces[pair[0]] != surfaces[pair[1]] ||
        (left->near == triangle[odd]) != (right->near == triangle[odd])) {
      const auto farthest = std::max_element(ends.begin(), ends.end(), [](const Vec3d& a, const Vec3d& b) {
        return glm::dot(a, a) < glm::dot(b, b);
      });
      add(whole, std::span(&*farthest, 1));
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
    add({{ends[odd], odd_left, odd_right, {}}, 3}, std::array{ends[odd], odd_left, odd_right});
    add({{pair_left, ends[pair[0]], ends[pair[1]], pair_right}, 4},
        std::array{pair_left, ends[pair[0]], ends[pair[1]], pair_right});
    add({{odd_left, pair_left, pair_right, odd_right}, 4}, std::array{left->behind, right->behind});
  }
}

void MediumRecord::add_cut_shells(const std::array<uint32_t, 3>& triangle,
                                  const std::array<Vec3d, 3>& directions, RadianceJet& sum) const {
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
        sum.channels[static_cast<size_t>(channel)] +=
            transmittance * form * (excess(sample, channel) / std::max(alive, 1.0));
      }
    }
  }
}

RadianceJet MediumRecord::derivatives() const {
  RadianceJet sum;
  add_constant(sum);
  // Form factors of the unit sphere's triangles: those that nothing cuts are shared out to their corners.
  std::vector<Jet3d> cells(rays.size());
  for (const std::array<uint32_t, 3>& triangle : triangles) {
    const std::array<Vec3d, 3> directions{rays[triangle[0]].direction, rays[triangle[1]].direction,
                                          rays[triangle[2]].direction};
    const Jet3d third = triangle_form_factor_jet(RelativeTriangle<double>::from_relative(
                            directions[0], directions[1], directions[2])) *
                        (1.0 / 3);
    const bool cut = !same(rays[triangle[0]].surface, rays[triangle[1]].surface, rays[triangle[2]].surface);
    if (!cut) {
      for (const uint32_t ray : triangle) cells[ray] += third;
      continue;
    }
    const double nearest =
        std::min({end(rays[triangle[0]].end), end(rays[triangle[1]].end), end(rays[triangle[2]].end)});
    for (const uint32_t ray : triangle) {
      for (int c = 0; c < 3; ++c)
        sum.channels[static_cast<size_t>(c)] +=
            shell_jet(third, rays[ray].direction, moments(ray, nearest, c));
    }
    add_cut_shells(triangle, directions, sum);
  }
  for (size_t i = 0; i < rays.size(); ++i) {
    for (int c = 0; c < 3; ++c)
      sum.channels[static_cast<size_t>(c)] += shell_jet(cells[i], rays[i].direction, moments(i, far, c));
  }
  return sum;
}

}  // namespace fogbank::derivatives
