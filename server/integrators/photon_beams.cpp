#include "integrators/photon_beams.h"

#include <stdexcept>

#include "integrators/photon_preparation.h"

namespace fogbank::integrators {

namespace {

/// How fast noise may grow from pass to pass: the share of noise that averaging takes away and that goes into
/// a smaller radius. 2/3 makes squared bias on surfaces fall as fast as variance (radius ~ n^((alpha - 1) /
/// 2): bias^2 ~ n^(2 alpha - 2), variance ~ n^-alpha). For beams it would be 4/5, but at the edges of shafts,
/// where bias falls with the radius and not with its square, 1/2; 2/3 lies between them.
constexpr double alpha = 2.0 / 3;

transport::PathSettings path_settings(const IntegratorSettings& settings) {
  return {settings.max_depth, settings.rr_depth, settings.hide_emitters, settings.camera_medium};
}

}  // namespace

PhotonBeamsIntegrator::PhotonBeamsIntegrator(std::shared_ptr<const transport::World> world,
                                             const IntegratorSettings& settings)
    : world_(std::move(world)),
      tracer_(world_, path_settings(settings)),
      gather_(world_, path_settings(settings)) {}

PhotonBeamsIntegrator::Shrinking PhotonBeamsIntegrator::shrinking(uint32_t sample) {
  // Knaus and Zwicker 2011; Jarosz et al. 2011, "Progressive Photon Beams", for beams: what a kernel
  // covers, length or area, shrinks by (i + alpha) / (i + 1).
  double covered = 1;
  for (uint32_t i = 1; i <= sample; ++i) covered *= (i + alpha) / (i + 1.0);
  return {static_cast<float>(covered), static_cast<float>(std::sqrt(covered))};
}

PixelSample PhotonBeamsIntegrator::sample(const Ray& ray, RandomStream& random, RayCounters& counters) const {
  if (pass_ == nullptr || pass_->sample != random.sample())
    throw std::logic_error("photon-beams: a sample without its pass");
  const Gathered gathered = gather_.radiance(ray, *pass_, random, counters, nullptr);
  return {.sampled = gathered.radiance, .narrow = gathered.narrow};
}

std::unique_ptr<Preparation> PhotonBeamsIntegrator::prepare_pass(const CameraRays& camera,
                                                                 const PassSamples& samples) {
  if (!emission_) emission_.emplace(*world_);
  return std::make_unique<PhotonPreparation>(*this, camera, samples);
}

}  // namespace fogbank::integrators
