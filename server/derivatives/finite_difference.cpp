#include "derivatives/finite_difference.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "core/sampling.h"
#include "derivatives/correlated_light.h"
#include "derivatives/difference_stencil.h"
#include "derivatives/exact_light_visibility.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"
#include "derivatives/sightlines.h"

namespace fogbank::derivatives {

namespace {

/// Steps to begin with, as a share of the median distance to the surfaces around: with noise a small step
/// drowns in it.
constexpr double exact_step = 0.01;
constexpr double noisy_step = 0.03;
constexpr int32_t exact_halvings = 9;
constexpr int32_t noisy_halvings = 2;
constexpr double settled = 1e-3;
/// No step is longer than this share of the distance to the nearest surface, found by this many rays.
constexpr double clearance_share = 0.25;
constexpr int32_t look_side = 16;
/// Of settings.samples.
constexpr int32_t more_samples = 64;
constexpr int32_t most_directions = 1 << 22;

enum Stream : uint32_t { stencil_stream, surroundings_stream };

/// Fluence / (4 pi) of a delta light: K V T.
Vec3d delta_light(const transport::World& world, const transport::Light& light, const Vec3d& x,
                  int32_t medium, RayCounters& counters) {
  const std::optional<transport::LightSample> sample = light.sample(Vec3f(x), Vec2f(0.5f));
  if (!sample) return Vec3d(0);
  const bool infinite = light.at_infinity();
  const Vec3d u(sample->direction);
  const Vec3d r = infinite ? u : Vec3d(light.bounds().center) - x;
  Sightlines lines(world);
  lines.start(Vec3f(x), medium);
  if (infinite) {
    lines.append({&sample->direction, 1}, {&infinity, 1}, counters);
  } else {
    lines.append_to_points({&r, 1}, counters);
  }
  if (lines.is_blocked(0)) return Vec3d(0);
  const RadianceJet transmittance = infinite ? lines.path(0).towards_infinity(u) : lines.path(0).towards(r);
  // The sample's irradiance is in single precision; its fall with distance can be had in double.
  const double distance = sample->distance;
  const double fall = infinite ? 1 : distance * distance / glm::dot(r, r);
  Vec3d value = Vec3d(sample->radiance) * (static_cast<double>(inv_4pi) * fall);
  for (int c = 0; c < 3; ++c) value[c] *= transmittance.channels[static_cast<size_t>(c)].value;
  return value;
}

/// Distances to the surfaces around x.
struct Surroundings {
  double nearest = std::numeric_limits<double>::infinity();
  double median = 0;  ///< of those that are finite; 0 where none is
};

Surroundings look_around(const transport::World& world, const Vec3f& x, RandomStream& random,
                         RayCounters& counters) {
  std::vector<double> distances;
  for (int32_t cell = 0; cell < look_side * look_side; ++cell) {
    const Vec2f jitter = random.next_vec2();
    const Vec2f u =
        (Vec2f(Vec2i(cell % look_side, cell / look_side)) + jitter) / static_cast<float>(look_side);
    scene::Hit hit;
    ++counters.closest_hit;
    if (world.scene().intersector->intersect({x, square_to_uniform_sphere(u), infinity}, hit))
      distances.push_back(hit.distance);
  }
  if (distances.empty()) return {};
  std::sort(distances.begin(), distances.end());
  return {distances.front(), distances[distances.size() / 2]};
}

}  // namespace

FiniteDifference::FiniteDifference(std::shared_ptr<const transport::World> world,
                                   const EstimatorSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      plan_(*world_, plan_request(settings)),
      paths_(world_, transport::PathSettings{.max_depth = settings.max_depth}) {}

RadianceJet FiniteDifference::estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const {
  const int32_t medium = world_->medium_at(x);
  const transport::LightSampler& lights = world_->lights();
  const ValueFunction exact = [&](const Vec3d& at) {
    Vec3d sum(0);
    for (uint32_t light = 0; light < lights.size(); ++light) {
      switch (plan_.treatment(light)) {
        case transport::LightTreatment::closed_form:
          sum += delta_light(*world_, lights.light(light), at, medium, counters);
          break;
        case transport::LightTreatment::light_grid:
          sum += exact_direct_light(*world_, plan_, light, at, medium, {}, counters);
          break;
        default:
          break;
      }
    }
    return ValueBatches{sum};
  };

  RandomStream stencil = random_at(x, settings_.seed, repeat, stencil_stream);
  RandomStream around = random_at(x, settings_.seed, 0, surroundings_stream);
  const Surroundings surroundings = look_around(*world_, x, around, counters);
  double scale = surroundings.median;
  if (scale == 0) scale = world_->scene().bounds.radius > 0 ? world_->scene().bounds.radius : 1;
  const double longest = clearance_share * surroundings.nearest;
  const bool with_hessian = settings_.derivatives == DerivativeOrder::hessian;
  const bool with_any = settings_.derivatives != DerivativeOrder::value;
  const auto differences = [&](const ValueFunction& function, double share, int32_t halvings) {
    if (with_any)
      return central_differences(function, Vec3d(x), {std::min(share * scale, longest), halvings, settled},
                                 with_hessian, stencil);
    RadianceJet result;
    const ValueBatches batches = function(Vec3d(x));
    for (size_t c = 0; c < 3; ++c)
      for (const Vec3d& batch : batches)
        result.channels[c].value += batch[static_cast<int>(c)] / static_cast<double>(batches.size());
    return result;
  };

  RadianceJet sum = differences(exact, exact_step, exact_halvings);
  const bool environment = std::any_of(
      world_->environments().begin(), world_->environments().end(),
      [this](uint32_t light) { return plan_.treatment(light) != transport::LightTreatment::left_out; });
  if (environment || plan_.reflected() || plan_.mirrors() || plan_.shells()) {
    const int32_t directions =
        static_cast<int32_t>(std::min<int64_t>(int64_t{settings_.samples} * more_samples, most_directions));
    const CorrelatedLight rest(*world_, plan_, paths_, directions, x, settings_.seed, repeat);
    sum += differences([&](const Vec3d& at) { return rest.at(at, medium, counters); }, noisy_step,
                       noisy_halvings);
  }
  return sum;
}

}  // namespace fogbank::derivatives
