#include "derivatives/finite_difference.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/sampling.h"
#include "derivatives/correlated_light.h"
#include "derivatives/difference_stencil.h"
#include "derivatives/exact_light_visibility.h"
#include "derivatives/light_rays.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"

namespace fogbank::derivatives {

namespace {

/// Steps to begin with, as a share of the scene's radius: with noise a small step drowns in it.
constexpr double exact_step = 0.01;
constexpr double noisy_step = 0.03;
constexpr int32_t exact_halvings = 9;
constexpr int32_t noisy_halvings = 2;
/// No step is longer than this share of the distance to the nearest surface, found by this many rays.
constexpr double clearance_share = 0.25;
constexpr int32_t clearance_side = 16;
/// Of settings.samples.
constexpr int32_t more_samples = 64;
constexpr int32_t most_directions = 1 << 22;

enum Stream : uint32_t { stencil_stream, clearance_stream };

/// Fluence / (4 pi) of a delta light: K V T.
Vec3d delta_light(const transport::World& world, const transport::Light& light, const Vec3d& x,
                  int32_t medium, RayCounters& counters) {
  const std::optional<transport::LightSample> sample = light.sample(Vec3f(x), Vec2f(0.5f));
  if (!sample) return Vec3d(0);
  const bool infinite = light.at_infinity();
  const Vec3d u(sample->direction);
  const Vec3d r = infinite ? u : Vec3d(light.bounds().center) - x;
  MediaPath path;
  LightRays(world, Vec3f(x), medium, counters).trace({&r, 1}, infinite, {&path, 1});
  if (path.blocked()) return Vec3d(0);
  const RadianceJet transmittance = infinite ? path.towards_infinity(u) : path.towards(r);
  // The sample's irradiance is in single precision; its fall with distance can be had in double.
  const double distance = sample->distance;
  const double fall = infinite ? 1 : distance * distance / glm::dot(r, r);
  Vec3d value = Vec3d(sample->radiance) * (static_cast<double>(inv_4pi) * fall);
  for (int c = 0; c < 3; ++c) value[c] *= transmittance.channels[static_cast<size_t>(c)].value;
  return value;
}

double clearance(const transport::World& world, const Vec3f& x, RandomStream& random, RayCounters& counters) {
  float nearest = infinity;
  for (int32_t cell = 0; cell < clearance_side * clearance_side; ++cell) {
    const Vec2f jitter = random.next_vec2();
    const Vec2f u =
        (Vec2f(cell % clearance_side, cell / clearance_side) + jitter) / static_cast<float>(clearance_side);
    scene::Hit hit;
    ++counters.closest_hit;
    if (world.scene().intersector->intersect({x, square_to_uniform_sphere(u), infinity}, hit))
      nearest = std::fmin(nearest, hit.distance);
  }
  return nearest;
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
  RandomStream around = random_at(x, settings_.seed, 0, clearance_stream);
  const double radius = world_->scene().bounds.radius > 0 ? world_->scene().bounds.radius : 1;
  const double longest = clearance_share * clearance(*world_, x, around, counters);
  const bool with_hessian = settings_.derivatives == DerivativeOrder::hessian;
  const bool with_any = settings_.derivatives != DerivativeOrder::value;
  const auto differences = [&](const ValueFunction& function, double share, int32_t halvings) {
    if (with_any)
      return central_differences(function, Vec3d(x), {std::min(share * radius, longest), halvings, 1e-4},
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
