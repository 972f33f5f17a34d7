#include "derivatives/sightlines.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

/// More surfaces than this along one line count as opaque: a guard against surfaces that coincide.
constexpr uint32_t most_crossings = 256;
/// Whole packets, for a few milliseconds.
constexpr size_t lines_between_polls = 2048;

Spectrum sigma_t_of(const transport::World& world, int32_t medium) {
  return medium == scene::none ? Spectrum(0) : world.medium(medium).sigma_t;
}

}  // namespace

void Sightlines::start(const Vec3f& origin, int32_t medium) {
  origin_ = origin;
  medium_ = medium;
  directions_.clear();
  hits_.clear();
  passages_.clear();
  crossings_.clear();
}

size_t Sightlines::append(std::span<const Vec3f> directions, std::span<const float> max_distances,
                          RayCounters& counters, RandomStream* stops) {
  const size_t first = size();
  directions_.insert(directions_.end(), directions.begin(), directions.end());
  hits_.resize(directions_.size());
  passages_.resize(directions_.size());
  for (size_t begin = 0; begin < directions.size(); begin += lines_between_polls) {
    counters.poll();
    const size_t count = std::min(lines_between_polls, directions.size() - begin);
    trace(first + begin, count,
          max_distances.size() == 1 ? max_distances : max_distances.subspan(begin, count), counters, stops);
  }
  return first;
}

void Sightlines::trace(size_t first, size_t count, std::span<const float> max_distances,
                       RayCounters& counters, RandomStream* stops) {
  const scene::Intersector& intersector = *world_.scene().intersector;
  const scene::RayBundle bundle{origin_, std::span(directions_).subspan(first, count), max_distances};
  intersector.intersect_solid(bundle, std::span(hits_).subspan(first, count));
  counters.closest_hit += count;
  if (!intersector.has_passing_surfaces()) return;

  // Only what lies before the solid surfaces counts.
  limits_.resize(count);
  passing_hits_.resize(count);
  for (size_t i = 0; i < count; ++i) limits_[i] = std::min(hits_[first + i].distance, bundle.max_distance(i));
  intersector.intersect_passing({origin_, bundle.directions, limits_}, passing_hits_);
  counters.closest_hit += count;
  for (size_t i = 0; i < count; ++i) {
    if (std::isfinite(passing_hits_[i].distance))
      cross(first + i, passing_hits_[i], limits_[i], counters, stops);
  }
}

size_t Sightlines::append_to_points(std::span<const Vec3d> relative, RayCounters& counters) {
  std::vector<Vec3f> directions(relative.size());
  std::vector<float> max_distances(relative.size());
  for (size_t i = 0; i < relative.size(); ++i) {
    const double length = glm::length(relative[i]);
    directions[i] = Vec3f(relative[i] / length);
    max_distances[i] = static_cast<float>(length) * transport::shadow_share;
  }
  return append(directions, max_distances, counters);
}

void Sightlines::cross(size_t line, const scene::Hit& first_hit, float limit, RayCounters& counters,
                       RandomStream* stops) {
  const scene::Scene& scene = world_.scene();
  const Vec3f& direction = directions_[line];
  Passage& passage = passages_[line];
  passage.first = static_cast<uint32_t>(crossings_.size());
  Ray ray{origin_, direction, limit};
  scene::Hit hit = first_hit;
  int32_t medium = medium_;
  Spectrum through(1);
  float passed = 0;
  while (true) {
    const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
    const transport::ShadingPoint point = transport::World::shading_point(surface);
    const Spectrum share =
        world_.bsdf(surface.shape).null_transmission(point, point.frame.to_local(-direction));
    // A choice by whole numbers draws nothing: most such surfaces are boundaries or cut-outs.
    const float pass = std::clamp(mean(share), 0.0f, 1.0f);
    const bool chosen = stops != nullptr && pass > 0 && pass < 1;
    const bool ends = is_black(through * share) || passage.count >= most_crossings ||
                      (chosen && stops->next_float() >= pass);
    const float here = std::min(passed + hit.distance, limit);
    if (ends) {
      hits_[line] = hit;
      hits_[line].distance = here;
      // The share that ends here is weighted as the last crossing's, at no distance from the surface.
      if (chosen && !is_black(through * share)) {
        crossings_.push_back({here, surface.geometric_normal, medium, through / (1 - pass)});
        ++passage.count;
      }
      return;
    }
    through *= chosen ? share / pass : share;
    medium = world_.medium_beyond(surface, direction, medium);
    crossings_.push_back({here, surface.geometric_normal, medium, through});
    ++passage.count;
    passed = here;
    ray.origin = surface.spawn_origin(direction);
    if (std::isfinite(limit)) ray.max_distance = limit - passed;
    if (!(ray.max_distance > 0)) return;
    ++counters.closest_hit;
    if (!scene.intersector->intersect_passing(ray, hit)) return;
  }
}

scene::SurfaceInteraction Sightlines::surface(size_t line) const {
  return world_.scene().interaction({origin_, directions_[line], infinity}, hits_[line]);
}

Spectrum Sightlines::transmittance(size_t line, float distance) const {
  Spectrum through(1);
  int32_t medium = medium_;
  float begin = 0;
  const auto pass = [&](float end) {
    if (medium != scene::none)
      through *= transport::transmittance(world_.medium(medium).sigma_t, std::max(end - begin, 0.0f));
  };
  for (const Crossing& crossing : crossings(line)) {
    if (crossing.medium == medium) continue;
    pass(crossing.distance);
    begin = crossing.distance;
    medium = crossing.medium;
  }
  pass(distance);
  return through * factor(line);
}

bool Sightlines::changes_medium(size_t line) const {
  for (const Crossing& crossing : crossings(line))
    if (sigma_t_of(world_, crossing.medium) != sigma_t_of(world_, medium_)) return true;
  return false;
}

MediaPath Sightlines::path(size_t line) const {
  MediaPath path;
  path.surfaces = factor(line);
  path.sigma_t = sigma_t_of(world_, medium_);
  int32_t medium = medium_;
  for (const Crossing& crossing : crossings(line)) {
    if (crossing.medium == medium) continue;
    medium = crossing.medium;
    path.boundaries.push_back({Vec3d(directions_[line]) * static_cast<double>(crossing.distance),
                               Vec3d(crossing.normal), sigma_t_of(world_, medium)});
  }
  return path;
}

void visibility(const transport::World& world, const Vec3f& origin, int32_t medium,
                std::span<const Vec3d> relative, std::span<Spectrum> transmittances, RayCounters& counters) {
  const scene::Intersector& intersector = *world.scene().intersector;
  std::vector<Vec3f> directions(relative.size());
  std::vector<float> distances(relative.size());
  for (size_t i = 0; i < relative.size(); ++i) {
    counters.poll_at(i);
    const double length = glm::length(relative[i]);
    const auto distance = static_cast<float>(length);
    directions[i] = Vec3f(relative[i] / length);
    transmittances[i] = world.unblocked_transmittance(origin, directions[i], distance, medium, counters);
    // Nothing is left to ask the solid surfaces for where the media let nothing through.
    distances[i] = is_black(transmittances[i]) ? 0 : distance * transport::shadow_share;
    counters.any_hit += static_cast<uint64_t>(distances[i] > 0);
  }
  std::vector<uint8_t> occluded(relative.size());
  for (size_t begin = 0; begin < relative.size(); begin += lines_between_polls) {
    counters.poll();
    const size_t count = std::min(lines_between_polls, relative.size() - begin);
    intersector.occluded(
        {origin, std::span(directions).subspan(begin, count), std::span(distances).subspan(begin, count)},
        std::span(occluded).subspan(begin, count));
  }
  for (size_t i = 0; i < relative.size(); ++i)
    if (occluded[i] != 0) transmittances[i] = Spectrum(0);
}

}  // namespace fogbank::derivatives
