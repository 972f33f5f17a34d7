#include "derivatives/unaware.h"

#include <algorithm>
#include <optional>

#include "core/sampling.h"
#include "derivatives/light_rays.h"
#include "derivatives/light_surface.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

namespace {

/// Lengths below this share of the scene's radius count as it (method.md section 4.5).
constexpr double least_share = 1e-4;
/// Cosines at y below this count as it: a kernel's derivative grows as their inverse.
constexpr double least_cosine = 1e-6;
/// Of settings.samples, for one shadow ray to each emitter.
constexpr int32_t directions_per_shadow_ray = 5;
/// March points along a direction in one medium, up to where transmittance falls below 1e-4.
constexpr int32_t march_steps = 16;
constexpr float most_optical_depth = 9.2f;
/// More boundaries than this along a direction end it: a guard against surfaces that coincide.
constexpr int most_boundaries = 256;

enum Stream : uint32_t { light_stream, sphere_stream, march_stream };

/// (l / l(x))^-power as a field of x, 1 here, for the fixed point x + r.
Jet3d relative_power(const Vec3d& r, double power) {
  const Jet3d length = distance_jet(r);
  const double inverse = 1 / length.value;
  return chain(length, 1.0, -power * inverse, power * (power + 1) * inverse * inverse);
}

/// Surface kernel without transmittance, (n . r) / l^3, relative to its value here.
Jet3d relative_surface_kernel(const Vec3d& r, const Vec3d& n) {
  const double length = glm::length(r);
  const double across = glm::dot(n, r);
  const double least = least_cosine * length;
  const double safe = std::fabs(across) < least ? std::copysign(least, across) : across;
  return Jet3d::linear(1, n * (-1 / safe)) * relative_power(r, 3);
}

}  // namespace

/// One estimate in the making.
struct Unaware::Gather {
  const Unaware& owner;
  Vec3f at{0};
  Vec3d x{0};
  int32_t medium = scene::none;
  double least_length = 0;
  uint32_t repeat = 0;
  float march_phase = 0;  ///< the same along all directions
  RandomStream march_random;
  RayCounters& counters;
  RadianceJet sum;

  /// `r`, kept from being too short.
  Vec3d kept_apart(const Vec3d& r) const {
    const double length = glm::length(r);
    if (length >= least_length) return r;
    return (length > 0 ? r / length : Vec3d(0, 0, 1)) * least_length;
  }

  /// Adds `value`, already divided by densities and the number of samples and still without transmittance.
  /// `geometry` makes the rest of the kernel, relative to its value; only where derivatives were asked for.
  template <typename Geometry>
  void add(const Spectrum& value, const Geometry& geometry, const RadianceJet& transmittance) {
    const bool value_only = owner.settings_.derivatives == DerivativeOrder::value;
    const Jet3d rest = value_only ? Jet3d::constant(1) : geometry();
    for (int c = 0; c < 3; ++c) {
      const auto channel = static_cast<size_t>(c);
      sum.channels[channel] += rest * transmittance.channels[channel] * static_cast<double>(value[c]);
    }
  }
};

Unaware::Unaware(std::shared_ptr<const transport::World> world, const EstimatorSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      plan_(*world_, plan_request(settings)),
      paths_(world_, transport::PathSettings{.max_depth = settings.max_depth}) {
  for (const scene::Shape& shape : world_->scene().shapes)
    if (shape.emitter != scene::none) ++emitters_;
  emitters_ += static_cast<int32_t>(world_->environments().size());
}

RadianceJet Unaware::estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const {
  RandomStream march_random = random_at(x, settings_.seed, repeat, march_stream);
  const float phase = march_random.next_float();
  Gather gather{.owner = *this,
                .at = x,
                .x = Vec3d(x),
                .medium = world_->medium_at(x),
                .least_length = std::max(least_share * static_cast<double>(world_->scene().bounds.radius),
                                         smallest_distance<double>()),
                .repeat = repeat,
                .march_phase = phase,
                .march_random = march_random,
                .counters = counters,
                .sum = {}};
  add_lights(gather);
  if (plan_.reflected() || plan_.mirrors() || plan_.shells()) add_sphere(gather);
  return gather.sum;
}

void Unaware::add_lights(Gather& gather) const {
  RandomStream random = random_at(gather.at, settings_.seed, gather.repeat, light_stream);
  const transport::LightReceiver receiver{
      gather.at, Vec3f(0), gather.medium == scene::none ? 0 : world_->medium(gather.medium).mean_sigma_t};
  const auto budget = static_cast<float>(settings_.samples / directions_per_shadow_ray * emitters_);
  const LightRays rays(*world_, gather.at, gather.medium, gather.counters);
  for (uint32_t index = 0; index < world_->lights().size(); ++index) {
    if (plan_.treatment(index) == transport::LightTreatment::left_out) continue;
    const transport::Light& light = world_->lights().light(index);
    const transport::LightShape shape = light.shape();
    const int32_t side = light.is_delta()
                             ? 1
                             : std::max(1, static_cast<int32_t>(std::lround(std::sqrt(
                                               budget * world_->lights().probability(receiver, index)))));
    const float share = 1.0f / static_cast<float>(side);
    for (int32_t cell = 0; cell < side * side; ++cell) {
      const Vec2f jitter = random.next_vec2();
      const Vec2f u = glm::min((Vec2f(cell % side, cell / side) + jitter) * share, Vec2f(one_minus_epsilon));
      const std::optional<transport::LightSample> sample = light.sample(gather.at, u);
      if (!sample || is_black(sample->radiance)) continue;
      const Spectrum value = sample->radiance * (inv_4pi * share * share / sample->pdf);
      if (!is_finite(value)) continue;
      const Vec3d u_direction(sample->direction);
      const Vec3d target =
          light.at_infinity() ? u_direction : u_direction * static_cast<double>(sample->distance);
      MediaPath path;
      rays.trace({&target, 1}, light.at_infinity(), {&path, 1});
      if (path.blocked()) continue;
      if (light.at_infinity()) {
        gather.add(
            value, [] { return Jet3d::constant(1); }, path.towards_infinity(u_direction));
        continue;
      }
      const Vec3d r = gather.kept_apart(target);
      gather.add(
          value,
          [&] {
            return light.is_delta() ? relative_power(r, 2)
                                    : relative_surface_kernel(r, light_normal(shape, gather.x + target));
          },
          path.towards(r));
    }
  }
}

void Unaware::add_sphere(Gather& gather) const {
  RandomStream random = random_at(gather.at, settings_.seed, gather.repeat, sphere_stream);
  const auto side = static_cast<int32_t>(std::lround(std::sqrt(static_cast<float>(settings_.samples))));
  const float share = 1.0f / static_cast<float>(side);
  for (int32_t cell = 0; cell < side * side; ++cell) {
    const Vec2f jitter = random.next_vec2();
    const Vec3f direction = square_to_uniform_sphere(
        glm::min((Vec2f(cell % side, cell / side) + jitter) * share, Vec2f(one_minus_epsilon)));
    add_direction(gather, direction, share * share, random);
  }
}

void Unaware::add_direction(Gather& gather, const Vec3f& direction, float share, RandomStream& random) const {
  const scene::Scene& scene = world_->scene();
  const auto sigma_t_of = [this](int32_t medium) {
    return medium == scene::none ? Spectrum(0) : world_->medium(medium).sigma_t;
  };
  Ray ray{gather.at, direction, infinity};
  int32_t medium = gather.medium;
  float travelled = 0;
  MediaPath path{.surfaces = Spectrum(1), .sigma_t = sigma_t_of(medium), .boundaries = {}};
  for (int passed = 0; passed < most_boundaries; ++passed) {
    scene::Hit hit;
    ++gather.counters.closest_hit;
    const bool found = scene.intersector->intersect(ray, hit);
    if (medium != scene::none && plan_.shells())
      march(gather, direction, {travelled, found ? hit.distance : infinity, medium}, share, path);
    if (!found) return;
    const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
    travelled += hit.distance;
    if (!world_->is_null(hit.shape)) {
      if (!plan_.reflected() && !plan_.mirrors()) return;
      const Spectrum value =
          share * paths_.scattered_radiance(surface, direction, medium, 1, random, gather.counters);
      if (is_black(value) || !is_finite(value)) return;
      const Vec3d r = gather.kept_apart(Vec3d(direction) * static_cast<double>(travelled));
      gather.add(
          value, [&] { return relative_surface_kernel(r, Vec3d(surface.geometric_normal)); },
          path.towards(r));
      return;
    }
    const int32_t beyond = world_->medium_beyond(surface, direction, medium);
    if (beyond != medium)
      path.boundaries.push_back({Vec3d(direction) * static_cast<double>(travelled),
                                 Vec3d(surface.geometric_normal), sigma_t_of(beyond)});
    medium = beyond;
    ray.origin = surface.spawn_origin(direction);
  }
}

void Unaware::march(Gather& gather, const Vec3f& direction, const Stretch& stretch, float share,
                    const MediaPath& path) const {
  const transport::MediumInfo& medium = world_->medium(stretch.medium);
  if (is_black(medium.sigma_s)) return;
  const float least_sigma = min_component(medium.sigma_t);
  const float length =
      least_sigma > 0 ? std::fmin(stretch.length, most_optical_depth / least_sigma) : stretch.length;
  if (!std::isfinite(length)) return;
  const float step = length / march_steps;
  for (int32_t k = 0; k < march_steps; ++k) {
    const float distance = stretch.begin + (static_cast<float>(k) + gather.march_phase) * step;
    const Spectrum value = share * step * medium.sigma_s *
                           paths_.mean_radiance(gather.at + direction * distance, stretch.medium, 1,
                                                gather.march_random, gather.counters);
    if (is_black(value) || !is_finite(value)) continue;
    const Vec3d r = gather.kept_apart(Vec3d(direction) * static_cast<double>(distance));
    gather.add(
        value, [&] { return relative_power(r, 2); }, path.towards(r));
  }
}

}  // namespace fogbank::derivatives
