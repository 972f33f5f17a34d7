#include "derivatives/unaware.h"

#include <algorithm>
#include <optional>

#include "core/sampling.h"
#include "derivatives/light_surface.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"
#include "derivatives/sightlines.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

namespace {

/// Lengths below this share of the scene's radius count as it (method.md section 4.5).
constexpr double least_share = 1e-4;
/// Cosines at y below this count as it: a kernel's derivative grows as their inverse.
constexpr double least_cosine = 1e-6;
/// Of settings.samples, for one shadow ray to each emitter.
constexpr int32_t directions_per_shadow_ray = 5;
/// Points along a direction in each medium, as many as the other method takes of a noisy source.
constexpr int32_t march_strata = 4;

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
  UnawareEstimate sum;

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
    RadianceJet sample;
    for (int c = 0; c < 3; ++c) {
      const auto channel = static_cast<size_t>(c);
      sample.channels[channel] = rest * transmittance.channels[channel] * static_cast<double>(value[c]);
    }
    sum.mean += sample;
    sum.gradient_magnitude += glm::length(sample.luminance().gradient);
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

UnawareEstimate Unaware::estimate_changes(const Vec3f& x, uint32_t repeat, RayCounters& counters) const {
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
  const int64_t shadow_rays = int64_t{settings_.samples / directions_per_shadow_ray} * emitters_;
  const auto budget = static_cast<float>(shadow_rays);
  Sightlines lines(*world_);
  std::vector<Vec3d> targets;
  std::vector<Vec3f> directions;
  std::vector<Spectrum> values;
  for (uint32_t index = 0; index < world_->lights().size(); ++index) {
    if (plan_.treatment(index) == transport::LightTreatment::left_out) continue;
    const transport::Light& light = world_->lights().light(index);
    const int32_t side = light.is_delta()
                             ? 1
                             : std::max(1, static_cast<int32_t>(std::lround(std::sqrt(
                                               budget * world_->lights().probability(receiver, index)))));
    const float share = 1.0f / static_cast<float>(side);
    targets.clear();
    directions.clear();
    values.clear();
    for (int32_t cell = 0; cell < side * side; ++cell) {
      gather.counters.poll_at(static_cast<size_t>(cell));
      const Vec2f jitter = random.next_vec2();
      const Vec2f u =
          glm::min((Vec2f(Vec2i(cell % side, cell / side)) + jitter) * share, Vec2f(one_minus_epsilon));
      const std::optional<transport::LightSample> sample = light.sample(gather.at, u);
      if (!sample || is_black(sample->radiance)) continue;
      const Spectrum value = sample->radiance * (inv_4pi * share * share / sample->pdf);
      if (!is_finite(value) || !(sample->distance > 0)) continue;
      values.push_back(value);
      directions.push_back(sample->direction);
      targets.push_back(Vec3d(sample->direction) * static_cast<double>(sample->distance));
    }
    lines.start(gather.at, gather.medium);
    if (light.at_infinity()) {
      lines.append(directions, {&infinity, 1}, gather.counters);
    } else {
      lines.append_to_points(targets, gather.counters);
    }
    const transport::LightShape shape = light.shape();
    for (size_t i = 0; i < values.size(); ++i) {
      gather.counters.poll_at(i);
      if (lines.is_blocked(i)) continue;
      if (light.at_infinity()) {
        gather.add(
            values[i], [] { return Jet3d::constant(1); },
            lines.path(i).towards_infinity(Vec3d(directions[i])));
        continue;
      }
      const Vec3d r = gather.kept_apart(targets[i]);
      gather.add(
          values[i],
          [&] {
            return light.is_delta() ? relative_power(r, 2)
                                    : relative_surface_kernel(r, light_normal(shape, gather.x + targets[i]));
          },
          lines.path(i).towards(r));
    }
  }
}

void Unaware::add_sphere(Gather& gather) const {
  RandomStream random = random_at(gather.at, settings_.seed, gather.repeat, sphere_stream);
  const auto side = static_cast<int32_t>(std::lround(std::sqrt(static_cast<float>(settings_.samples))));
  const float share = 1.0f / static_cast<float>(side);
  std::vector<Vec3f> directions;
  for (int32_t cell = 0; cell < side * side; ++cell) {
    gather.counters.poll_at(static_cast<size_t>(cell));
    const Vec2f jitter = random.next_vec2();
    directions.push_back(square_to_uniform_sphere(
        glm::min((Vec2f(Vec2i(cell % side, cell / side)) + jitter) * share, Vec2f(one_minus_epsilon))));
  }
  Sightlines lines(*world_);
  lines.start(gather.at, gather.medium);
  lines.append(directions, {&infinity, 1}, gather.counters, &random);
  for (size_t line = 0; line < lines.size(); ++line) {
    gather.counters.poll_at(line);
    if (plan_.shells()) march(gather, lines, line, share * share);
    if (!lines.is_blocked(line) || !(plan_.reflected() || plan_.mirrors())) continue;
    const scene::SurfaceInteraction surface = lines.surface(line);
    const Spectrum value = share * share *
                           paths_.scattered_radiance(surface, lines.direction(line), lines.last_medium(line),
                                                     1, random, gather.counters);
    if (is_black(value) || !is_finite(value)) continue;
    const Vec3d r =
        gather.kept_apart(Vec3d(lines.direction(line)) * static_cast<double>(lines.distance(line)));
    gather.add(
        value, [&] { return relative_surface_kernel(r, Vec3d(surface.geometric_normal)); },
        lines.path(line).towards(r));
  }
}

void Unaware::march(Gather& gather, const Sightlines& lines, size_t line, float share) const {
  const Vec3f& direction = lines.direction(line);
  const std::span<const Crossing> crossings = lines.crossings(line);
  MediaPath path = lines.path(line);
  for (size_t stretch = crossings.size() + 1; stretch-- > 0;) {
    const float begin = stretch > 0 ? crossings[stretch - 1].distance : 0;
    const float end = stretch < crossings.size() ? crossings[stretch].distance : lines.distance(line);
    const int32_t medium = stretch > 0 ? crossings[stretch - 1].medium : lines.medium();
    // What lies behind the stretch is none of its business.
    path.surfaces = stretch > 0 ? crossings[stretch - 1].through : Spectrum(1);
    while (!path.boundaries.empty() &&
           glm::length(path.boundaries.back().position) > static_cast<double>(begin) * (1 + 1e-6))
      path.boundaries.pop_back();
    if (medium == scene::none || is_black(world_->medium(medium).sigma_s)) continue;
    const transport::MediumInfo& info = world_->medium(medium);
    // Strata of equal mean transmittance.
    const float opacity = -std::expm1(-info.mean_sigma_t * (end - begin));
    for (int32_t k = 0; k < march_strata; ++k) {
      const float u = (static_cast<float>(k) + gather.march_phase) / march_strata;
      const float t = -std::log1p(-u * opacity) / info.mean_sigma_t;
      const float pdf = info.mean_sigma_t * std::exp(-info.mean_sigma_t * t) / opacity;
      const float distance = begin + t;
      const Spectrum value = (share / (march_strata * pdf)) * info.sigma_s *
                             paths_
                                 .light_in_medium(gather.at + direction * distance, direction, medium, 1,
                                                  gather.march_random, gather.counters)
                                 .scattered;
      if (is_black(value) || !is_finite(value)) continue;
      const Vec3d r = gather.kept_apart(Vec3d(direction) * static_cast<double>(distance));
      gather.add(
          value, [&] { return relative_power(r, 2); }, path.towards(r));
    }
  }
}

}  // namespace fogbank::derivatives
