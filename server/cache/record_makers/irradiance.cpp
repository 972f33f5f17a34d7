#include "cache/record_makers/irradiance.h"

#include <algorithm>
#include <cmath>

#include "core/frame.h"
#include "derivatives/estimator.h"
#include "derivatives/medium_rays.h"
#include "derivatives/path_source.h"
#include "derivatives/random_at.h"

namespace fogbank::cache {

namespace {

/// Of random numbers.
constexpr uint32_t estimate_stream = 32;

/// A surface is looked for this many radii of the scene around a wish's place.
constexpr float search_radii = 1e-4f;

/// Rays for the depth guard besides the estimate's: those are sparse near the horizon, where look-ups are.
constexpr uint32_t rings = 4;
constexpr uint32_t rays_a_ring = 32;

/// The gradient less what it is likely to owe to noise: the least mean square error of a multiple of it.
double trust(const derivatives::IrradianceEstimate& estimate) {
  const Vec3d gradient = estimate.mean.luminance().gradient;
  const double square = glm::dot(gradient, gradient);
  return square > 0 ? square / (square + estimate.gradient_variance) : 1;
}

}  // namespace

IrradianceRecordMaker::IrradianceRecordMaker(std::shared_ptr<const transport::World> world,
                                             const RecordMakerSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      kernel_(std::make_shared<transport::PathTracer>(
          world_, transport::PathSettings{.max_depth = settings.max_depth}, settings.photons)) {
  derivatives::validate({.samples = settings.samples, .max_depth = settings.max_depth});
}

uint64_t IrradianceRecordMaker::id_of(const Wish& wish) const {
  std::string settings = "irradiance " + std::to_string(settings_.samples) + ' ' +
                         std::to_string(settings_.max_depth) + ' ' + described(settings_.photons.get());
  for (int axis = 0; axis < 3; ++axis)
    settings += ' ' + std::to_string(std::bit_cast<uint32_t>(wish.normal[axis]));
  return content_id(wish.position, wish.component, settings, settings_.seed);
}

derivatives::SurfaceSide IrradianceRecordMaker::side_of(const Wish& wish, RayCounters& counters) const {
  const scene::Scene& scene = world_->scene();
  const float reach = search_radii * scene.bounds.radius;
  const Ray ray{wish.position + reach * wish.normal, -wish.normal, 2 * reach};
  derivatives::SurfaceSide side{{}, wish.normal, wish.component.medium};
  scene::Hit hit;
  ++counters.closest_hit;
  if (scene.intersector->intersect_solid(ray, hit)) {
    side.surface = scene.interaction(ray, hit);
  } else {
    // Seen at a grazing angle, or between two triangles: the wish is all there is.
    side.surface.position = wish.position;
    side.surface.position_error = Vec3f(search_radii * reach);
    side.surface.geometric_normal = wish.normal;
  }
  return side;
}

Record IrradianceRecordMaker::make(const Wish& wish, RayCounters& counters) const {
  if (settings_.photons) settings_.photons->complete(counters);
  const uint64_t rays_before = counters.total();
  const derivatives::SurfaceSide side = side_of(wish, counters);
  RandomStream random = derivatives::random_at(wish.position, settings_.seed, 0, estimate_stream);
  const auto estimate_from = [&](const auto& source) {
    return derivatives::gather_irradiance(*world_, {source, source}, side, {.samples = settings_.samples},
                                          random, counters);
  };
  const derivatives::IrradianceEstimate estimate =
      estimate_from(derivatives::PathTracedSource(kernel_, record_depth));
  Record record;
  record.position = wish.position;
  record.normal = wish.normal;
  record.component = wish.component;
  const double share = trust(estimate);
  const derivatives::Jet3d luminance = estimate.mean.luminance();
  for (int c = 0; c < 3; ++c) {
    const derivatives::Jet3d& channel = estimate.mean.channels[static_cast<size_t>(c)];
    record.radiance[c] = std::fmax(static_cast<float>(channel.value), 0.0f);
    record.gradient[static_cast<size_t>(c)] = Vec3f(share * channel.gradient);
  }
  for (size_t i = 0; i < 6; ++i) record.hessian.entries[i] = static_cast<float>(luminance.hessian.entries[i]);
  record.variance = static_cast<float>(estimate.variance);

  const Frame frame = Frame::from_normal(wish.normal);
  const Vec3f origin = side.surface.spawn_origin(wish.normal);
  for (uint32_t ring = 0; ring < rings; ++ring)
    for (uint32_t i = 0; i < rays_a_ring; ++i) {
      const float azimuth =
          2 * pi * (static_cast<float>(i) + 0.5f * static_cast<float>(ring % 2)) / rays_a_ring;
      const float sine = 0.03f + 0.12f * static_cast<float>(ring);
      const Vec3f direction = frame.to_world({std::sqrt(1 - sine * sine) * std::cos(azimuth),
                                              std::sqrt(1 - sine * sine) * std::sin(azimuth), sine});
      scene::Hit hit;
      ++counters.closest_hit;
      if (world_->scene().intersector->intersect_solid({origin, direction, infinity}, hit))
        record.depth.insert(direction, hit.distance);
    }
  record.samples = static_cast<uint32_t>(std::max<uint64_t>(counters.total() - rays_before, 1));
  record.id = id_of(wish);
  return record;
}

}  // namespace fogbank::cache
