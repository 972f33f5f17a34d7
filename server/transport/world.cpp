#include "transport/world.h"

#include <algorithm>
#include <array>
#include <utility>

#include "transport/medium_at.h"

namespace fogbank::transport {

namespace {

/// More surfaces than this along one shadow ray count as opaque: a guard against surfaces that coincide.
constexpr int most_passed_surfaces = 256;

Extent extent_of_medium(const scene::Scene& scene, int32_t medium) {
  Extent extent{Vec3f(infinity), Vec3f(-infinity)};
  const auto add = [&extent](const Vec3f& point) {
    extent.lower = glm::min(extent.lower, point);
    extent.upper = glm::max(extent.upper, point);
  };
  for (const scene::Shape& shape : scene.shapes) {
    if (!shape.is_medium_boundary) continue;
    // Outside a shape there is no end to see from here.
    if (shape.exterior_medium == medium) return Extent{};
    if (shape.interior_medium != medium) continue;
    if (shape.group != scene::none) return Extent{};
    if (shape.kind == scene::ShapeKind::triangle_mesh) {
      for (const Vec3f& position : scene.meshes[static_cast<size_t>(shape.mesh)].positions) add(position);
    } else {
      for (int corner = 0; corner < 8; ++corner) {
        const glm::dvec4 local((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1,
                               (corner & 4) != 0 ? 1 : -1, 1);
        add(Vec3f(Vec3d(shape.to_world * local)));
      }
    }
  }
  return extent.lower.x <= extent.upper.x ? extent : Extent{};
}

}  // namespace

World::World(std::shared_ptr<scene::Scene> scene) : scene_(std::move(scene)) {
  BsdfBuilder builder(*scene_->textures, scene_->lenient, scene_->warnings);
  bsdfs_.reserve(scene_->bsdfs.size());
  for (const scene::ObjectPointer& description : scene_->bsdfs) bsdfs_.push_back(builder.build(description));
  lights_of_ = build_lights(*scene_);
  scene_->load_times.textures = scene_->textures->seconds();  // read while BSDFs and lights were built
  light_sampler_ = std::make_unique<LightSampler>(std::move(lights_of_.lights));
  for (const uint32_t index : light_sampler_->infinite_lights()) {
    if (!light_sampler_->light(index).is_delta()) environments_.push_back(index);
  }
  for (int32_t i = 0; i < static_cast<int32_t>(scene_->media.size()); ++i) {
    const scene::Medium& medium = scene_->media[static_cast<size_t>(i)];
    MediumInfo info;
    info.sigma_t = medium.sigma_t;
    info.sigma_s = medium.sigma_s();
    info.albedo = medium.albedo;
    info.mean_sigma_t = mean(medium.sigma_t);
    info.grey = medium.sigma_t.x == medium.sigma_t.y && medium.sigma_t.y == medium.sigma_t.z;
    info.phase = build_phase_function(medium.phase, scene_->lenient ? &scene_->warnings : nullptr);
    info.extent = extent_of_medium(*scene_, i);
    media_.push_back(info);
  }
  boundary_points_ = points_on_medium_boundaries(*scene_);
}

Spectrum World::visibility(const Vec3f& origin, const Vec3f& direction, float distance, int32_t medium,
                           RayCounters& counters) const {
  // The few passing surfaces first: they may already leave nothing to ask the many solid ones for.
  const Spectrum through = unblocked_transmittance(origin, direction, distance, medium, counters);
  if (is_black(through)) return through;
  ++counters.any_hit;
  return scene_->intersector->occluded({origin, direction, distance * shadow_share}) ? Spectrum(0) : through;
}

void World::visibility(std::span<const Ray> rays, int32_t medium, std::span<Spectrum> visible,
                       RayCounters& counters) const {
  constexpr size_t batch_size = 64;
  std::array<Ray, batch_size> shadow_rays;
  std::array<uint8_t, batch_size> occluded;
  for (size_t first = 0; first < rays.size(); first += batch_size) {
    const size_t count = std::min(batch_size, rays.size() - first);
    for (size_t i = 0; i < count; ++i) {
      shadow_rays[i] = rays[first + i];
      shadow_rays[i].max_distance *= shadow_share;
    }
    counters.any_hit += count;
    scene_->intersector->occluded(std::span(shadow_rays).first(count), occluded);
    for (size_t i = 0; i < count; ++i) {
      const Ray& ray = rays[first + i];
      visible[first + i] = occluded[i] != 0 ? Spectrum(0)
                                            : unblocked_transmittance(ray.origin, ray.direction,
                                                                      ray.max_distance, medium, counters);
    }
  }
}

Spectrum World::unblocked_transmittance(const Vec3f& origin, const Vec3f& direction, float distance,
                                        int32_t medium, RayCounters& counters) const {
  const scene::Intersector& intersector = *scene_->intersector;
  if (!intersector.has_passing_surfaces()) {
    return medium == scene::none ? Spectrum(1)
                                 : transmittance(media_[static_cast<size_t>(medium)].sigma_t, distance);
  }
  Ray rest{origin, direction, distance * shadow_share};
  Spectrum through(1);
  int passed = 0;
  while (true) {
    scene::Hit hit;
    ++counters.closest_hit;
    const bool found = intersector.intersect_passing(rest, hit);
    // The last piece runs to the light itself, not to where the shadow ray stops short of it.
    const float piece = found ? hit.distance : rest.max_distance / shadow_share;
    if (medium != scene::none) through *= transmittance(media_[static_cast<size_t>(medium)].sigma_t, piece);
    if (is_black(through) || !found) return through;
    const scene::SurfaceInteraction surface = scene_->interaction(rest, hit);
    const ShadingPoint point = shading_point(surface);
    through *= bsdf(surface.shape).null_transmission(point, point.frame.to_local(-direction));
    if (is_black(through) || ++passed > most_passed_surfaces) return Spectrum(0);
    medium = medium_beyond(surface, direction, medium);
    rest.origin = surface.spawn_origin(direction);
    rest.max_distance -= hit.distance;  // infinite stays infinite
    if (!(rest.max_distance > 0)) return through;
  }
}

}  // namespace fogbank::transport
