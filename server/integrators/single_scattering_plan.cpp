#include "integrators/single_scattering_plan.h"

#include <algorithm>
#include <cmath>

#include "cache/record_makers/ratio.h"

namespace fogbank::integrators {

using derivatives::LightProxy;

namespace {

/// A light of a radius below this many pixels has penumbrae that records don't resolve.
constexpr float least_pixels = 3;
/// With more lights than this all are sampled.
constexpr size_t most_lights = 64;
/// Lights that send less than this share of the light matter to few pixels.
constexpr double least_share = 0.01;

// Costs in seconds of one core, typical of scenes/penumbra and scenes/shafts (README.md of the server).
constexpr double record_seconds = 0.1e-3;  ///< besides its rays
constexpr double rays_per_record = 650;
constexpr double look_up_seconds = 0.65e-6;
/// Samples along a segment, as SingleScatteringTerm takes them.
constexpr double samples_per_segment = 4;
/// Samples of the light that are worth one of its ratio.
constexpr double samples_per_look_up = 2;
/// Records of a light at a relative error of 0.02, and the power of the error that they go with.
constexpr double typical_records = 2000;
constexpr double typical_error = 0.02;
constexpr double records_power = -0.5;

/// Of a shadow ray with the sample of the light that it goes to.
double ray_seconds(const transport::World& world) {
  return (0.35 + 0.05 * std::log2(1 + static_cast<double>(world.scene().triangle_count()))) * 1e-6;
}

/// Of all lights, by the shapes that they are on.
std::vector<std::string> names_of_lights(const transport::World& world) {
  const scene::Scene& scene = world.scene();
  std::vector<std::string> names;
  for (uint32_t i = 0; i < world.lights().size(); ++i) names.push_back("light " + std::to_string(i));
  for (uint32_t i = 0; i < scene.shapes.size(); ++i) {
    const scene::Shape& shape = scene.shapes[i];
    if (shape.emitter == scene::none) continue;
    const size_t primitives = shape.kind == scene::ShapeKind::triangle_mesh
                                  ? scene.meshes[static_cast<size_t>(shape.mesh)].triangles.size()
                                  : 1;
    for (uint32_t primitive = 0; primitive < primitives; ++primitive)
      if (const uint32_t light = world.light_of_hit(i, primitive); light < names.size())
        names[light] = shape.id.empty() ? "the shape at " + shape.where.to_string() : '"' + shape.id + '"';
  }
  return names;
}

/// Share of each light in what the middle of the scene gets, after half a scene's radius of fog on the way
/// from a lamp: thick fog shows little of light that is scattered once.
std::vector<double> shares_of_light(const transport::World& world) {
  const scene::BoundingSphere& bounds = world.scene().bounds;
  float sigma_t = infinity;
  for (size_t medium = 0; medium < world.scene().media.size(); ++medium)
    sigma_t = std::fmin(sigma_t, world.medium(static_cast<int32_t>(medium)).mean_sigma_t);
  const float through = std::exp(-sigma_t * 0.5f * bounds.radius);
  std::vector<double> shares;
  double total = 0;
  for (uint32_t i = 0; i < world.lights().size(); ++i) {
    const transport::Light& light = world.lights().light(i);
    const bool is_lamp = !light.is_delta() && !light.at_infinity();
    shares.push_back(static_cast<double>(light.fluence(bounds.center) * (is_lamp ? through : 1.0f)));
    total += shares.back();
  }
  if (total > 0)
    for (double& share : shares) share /= total;
  return shares;
}

std::string seconds_text(double seconds) {
  const long milliseconds = std::lround(seconds * 1000);
  return milliseconds < 10000 ? std::to_string(milliseconds) + " ms"
                              : std::to_string(std::lround(seconds)) + " s";
}

/// Why records of the light can't be looked up; nothing if they can.
std::optional<std::string> hindrance(const transport::Light& light,
                                     const std::vector<std::optional<LightProxy>>& proxies,
                                     const CameraRays& camera) {
  if (light.is_delta()) return "it has no extent";
  if (light.at_infinity()) return "it comes from everywhere";
  if (std::ranges::none_of(proxies, [](const auto& proxy) { return proxy.has_value(); }))
    return "its unoccluded radiance has no closed form, or no medium scatters it alike in all directions";
  const transport::LightBounds& bounds = light.bounds();
  const float pixel = camera.pixel_angle() * glm::distance(camera.position(), bounds.center);
  if (bounds.radius < least_pixels * pixel)
    return "it is a few pixels wide: records don't resolve its penumbrae";
  return std::nullopt;
}

/// By predicted cost. `share` of the scene's light comes from this one.
void decide_by_cost(const transport::World& world, const IntegratorSettings& settings, double share,
                    double there, Decision& decision) {
  if (settings.most_records == 0) {
    decision.on = there > 0;
    decision.reason = std::to_string(std::lround(there)) + " records are there, and none may be made";
    return;
  }
  const double ray = ray_seconds(world);
  const double error = std::clamp(settings.expected_error, 1e-3, 1.0);
  const double wanted = typical_records * std::pow(error / typical_error, records_power);
  const double missing = std::max(wanted - there, 0.0);
  const double making = missing * (record_seconds + rays_per_record * ray);
  const double samples = static_cast<double>(settings.expected_samples) * samples_per_segment * share;
  const double saving = samples * (ray - look_up_seconds / samples_per_look_up);
  decision.on = saving > making && share > least_share;
  decision.reason = std::to_string(settings.expected_samples) + " camera samples save " +
                    seconds_text(std::max(saving, 0.0)) + " of shadow rays, about " +
                    std::to_string(std::lround(missing)) + " records take " + seconds_text(making);
}

}  // namespace

RatioPlaces ratio_places(const cache::RecordSet& records) {
  RatioPlaces places;
  for (const cache::ComponentRange& range : records.components()) {
    if (range.component.quantity != cache::Quantity::ratio) continue;
    places.resize(std::max<size_t>(places.size(), range.component.light_group + size_t{1}));
    places[range.component.light_group] += range.place_count;
  }
  return places;
}

SingleScatteringPlan single_scattering_plan(const transport::World& world, const IntegratorSettings& settings,
                                            const CameraRays& camera, const RatioPlaces& there) {
  SingleScatteringPlan result;
  const transport::LightSampler& lights = world.lights();
  if (lights.size() > most_lights) {
    result.decisions.push_back({"ratio records of " + std::to_string(lights.size()) + " lights", false,
                                "each would want records of its own"});
    return result;
  }
  const std::vector<std::string> names = names_of_lights(world);
  const std::vector<double> shares = shares_of_light(world);
  const transport::Plan plan(world, cache::RatioRecordMaker::plan_request());
  const size_t media = world.scene().media.size();

  result.proxies.resize(lights.size());
  result.decisions.resize(lights.size());
  for (uint32_t i = 0; i < lights.size(); ++i) {
    const transport::Light& light = lights.light(i);
    Decision& decision = result.decisions[i];
    decision.what = "ratio records of " + names[i];
    if (settings.single_scattering == SingleScattering::direct) {
      decision.reason = "the settings ask for samples";
      continue;
    }
    std::vector<std::optional<LightProxy>> proxies(media);
    for (size_t medium = 0; medium < media; ++medium) {
      const auto number = static_cast<int32_t>(medium);
      const transport::MediumInfo& info = world.medium(number);
      if (info.phase.is_isotropic() && !is_black(info.sigma_s))
        proxies[medium] = cache::RatioRecordMaker::make_proxy(world, plan, i, number);
    }
    if (const std::optional<std::string> why = hindrance(light, proxies, camera)) {
      decision.reason = *why;
      continue;
    }
    if (settings.single_scattering == SingleScattering::cached) {
      decision.on = true;
      decision.reason = "the settings ask for it";
    } else {
      const uint64_t places = i < there.size() ? there[i] : 0;
      decide_by_cost(world, settings, shares[i], static_cast<double>(places), decision);
    }
    if (decision.on) result.proxies[i] = std::move(proxies);
  }
  if (std::ranges::none_of(result.decisions, &Decision::on)) result.proxies.clear();
  return result;
}

}  // namespace fogbank::integrators
