#include "integrators/single_scattering_plan.h"

#include <algorithm>
#include <cmath>

#include "cache/record_makers/ratio.h"

namespace fogbank::integrators {

using derivatives::LightProxy;

namespace {

/// A light of a radius below this many pixels has penumbrae that records don't resolve.
constexpr float least_pixels = 3;
/// Lights that send less than this share of the light matter to few pixels.
constexpr double least_share = 0.01;

// Costs in seconds of one core, measured on scenes/ (README.md of the server, "Single scattering").
constexpr double record_seconds = 0.35e-3;
constexpr double rays_per_record = 650;
constexpr double look_up_seconds = 0.3e-6;
/// Samples along a segment, as SingleScatteringTerm takes them.
constexpr double samples_per_segment = 4;
/// Variance of a sample of the light against one of the ratio.
constexpr double variance_ratio = 2.5;
/// Records of a light at a relative error of 0.02, and the power of the error that they go with.
constexpr double typical_records = 2000;
constexpr double typical_error = 0.02;
constexpr double records_power = -0.75;

/// Of a shadow ray with the sample of the light that it goes to.
double ray_seconds(const transport::World& world) {
  return (0.25 + 0.03 * std::log2(1 + static_cast<double>(world.scene().triangle_count()))) * 1e-6;
}

std::string name_of(const transport::World& world, uint32_t light) {
  const scene::Scene& scene = world.scene();
  for (uint32_t i = 0; i < scene.shapes.size(); ++i) {
    const scene::Shape& shape = scene.shapes[i];
    if (shape.emitter == scene::none) continue;
    const size_t primitives = shape.kind == scene::ShapeKind::triangle_mesh
                                  ? scene.meshes[static_cast<size_t>(shape.mesh)].triangles.size()
                                  : 1;
    for (uint32_t primitive = 0; primitive < primitives; ++primitive)
      if (world.light_of_hit(i, primitive) == light)
        return shape.id.empty() ? "the shape at " + shape.where.to_string() : "\"" + shape.id + "\"";
  }
  return "light " + std::to_string(light);
}

std::string seconds_text(double seconds) {
  const long milliseconds = std::lround(seconds * 1000);
  return milliseconds < 10000 ? std::to_string(milliseconds) + " ms"
                              : std::to_string(std::lround(seconds)) + " s";
}

size_t count_records(const cache::RecordSet& records, uint32_t light) {
  size_t count = 0;
  for (const cache::ComponentRange& range : records.components())
    if (range.component.quantity == cache::Quantity::ratio && range.component.light_group == light)
      count += range.place_count;
  return count;
}

/// Whether records of the light may be looked up at all; if not, why.
std::optional<std::string> hindrance(const transport::World& world, const transport::Light& light,
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
  (void)world;
  return std::nullopt;
}

}  // namespace

std::vector<LightTechnique> single_scattering_plan(const transport::World& world,
                                                   const IntegratorSettings& settings,
                                                   const CameraRays& camera,
                                                   const cache::RecordSet& records) {
  const transport::LightSampler& lights = world.lights();
  const auto media = static_cast<int32_t>(world.scene().media.size());
  const transport::Plan plan(world, cache::RatioRecordMaker::plan_request());
  double total = 0;
  for (uint32_t i = 0; i < lights.size(); ++i)
    total += static_cast<double>(lights.light(i).fluence(world.scene().bounds.center));

  std::vector<LightTechnique> result(lights.size());
  for (uint32_t i = 0; i < lights.size(); ++i) {
    const transport::Light& light = lights.light(i);
    LightTechnique& technique = result[i];
    technique.decision.what = "ratio records of " + name_of(world, i);
    if (settings.single_scattering == SingleScattering::direct) {
      technique.decision.reason = "single scattering is to be sampled, the settings say";
      continue;
    }
    std::vector<std::optional<LightProxy>> proxies(static_cast<size_t>(media));
    for (int32_t medium = 0; medium < media; ++medium) {
      const transport::MediumInfo& info = world.medium(medium);
      if (info.phase.is_isotropic() && !is_black(info.sigma_s))
        proxies[static_cast<size_t>(medium)] = cache::RatioRecordMaker::make_proxy(world, plan, i, medium);
    }
    if (const auto why = hindrance(world, light, proxies, camera)) {
      technique.decision.reason = *why;
      continue;
    }
    if (settings.single_scattering == SingleScattering::cached) {
      technique.decision.reason = "the settings ask for it";
      technique.decision.on = true;
    } else {
      const double share =
          total > 0 ? static_cast<double>(light.fluence(world.scene().bounds.center)) / total : 0;
      const auto there = static_cast<double>(count_records(records, i));
      const double ray = ray_seconds(world);
      const double error = std::clamp(settings.expected_error, 1e-3, 1.0);
      const double wanted = typical_records * std::pow(error / typical_error, records_power);
      const double missing = std::max(wanted - there, 0.0);
      const double making = missing * (record_seconds + rays_per_record * ray);
      const double saving = static_cast<double>(settings.expected_samples) * samples_per_segment * share *
                            (ray - look_up_seconds / variance_ratio);
      technique.decision.on = saving > making && share > least_share;
      technique.decision.reason = "about " + std::to_string(std::lround(missing)) + " records to make, " +
                                  seconds_text(making) + ", would save " +
                                  seconds_text(std::max(saving, 0.0)) + " of shadow rays";
    }
    if (technique.decision.on) technique.proxies = std::move(proxies);
  }
  return result;
}

}  // namespace fogbank::integrators
