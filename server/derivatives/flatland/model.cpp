#include "derivatives/flatland/model.h"

#include <cmath>
#include <optional>
#include <string>

#include "core/error.h"
#include "derivatives/flatland/aware.h"
#include "derivatives/flatland/direct_radiance.h"
#include "derivatives/flatland/scattered_radiance.h"
#include "derivatives/flatland/unaware.h"

namespace fogbank::derivatives::flatland {

namespace {

[[noreturn]] void refuse(const std::string& field, const std::string& problem) {
  throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS", field + ": " + problem);
}

double default_step(const Scene& scene, const Settings& settings) {
  // sigma_t = 0 makes no medium; any step does.
  const double step = std::min(0.25 / std::max(scene.sigma_t(), 1e-300), scene.diagonal() / 32);
  const double shortest = 1.001 * settings.samples * scene.reach() / largest_march_points;
  return std::max(shortest, step / std::max(1.0, std::sqrt(settings.samples / 64.0)));
}

Settings checked(const Scene& scene, Settings settings) {
  const auto range = [](const std::string& field, int64_t number, int64_t least, int64_t greatest) {
    if (number < least || number > greatest)
      refuse(field, "must be " + std::to_string(least) + " to " + std::to_string(greatest));
  };
  range("samples", settings.samples, smallest_sample_count, largest_sample_count);
  range("bisections", settings.bisections, 0, largest_bisection_count);
  if (!(settings.march_step >= 0 && settings.march_step <= largest_number))
    refuse("march_step", "must be positive, or 0 for the default");
  if (settings.march_step == 0) settings.march_step = default_step(scene, settings);
  if (settings.order != Order::single && settings.method != Method::exact) {
    const double points = settings.samples * (scene.reach() / settings.march_step);
    if (!(points <= static_cast<double>(largest_march_points))) {
      refuse("march_step", "gives more than " + std::to_string(largest_march_points) +
                               " points of the march; fewer samples or a longer step, please");
    }
  }
  return settings;
}

}  // namespace

struct Model::Parts {
  Parts(const SceneDescription& description, const Settings& wanted)
      : scene(description), settings(checked(scene, wanted)), source(scene) {
    if (settings.method == Method::exact && settings.order != Order::single) reference.emplace(scene, source);
  }

  Estimate single(const Vec2d& x) const {
    switch (settings.method) {
      case Method::exact:
        return from_exact(direct_radiance<Jet2d>(scene, x));
      case Method::unaware:
        return estimate_surfaces_unaware(scene, settings, x);
      case Method::aware:
        break;
    }
    return estimate_surfaces_aware(scene, settings, x);
  }

  Estimate multiple(const Vec2d& x) const {
    if (scene.sigma_s() == 0) return {};
    switch (settings.method) {
      case Method::exact:
        return from_exact(reference->at(x));
      case Method::unaware:
        return estimate_medium_unaware(scene, source, settings, x);
      case Method::aware:
        break;
    }
    return estimate_medium_aware(scene, source, settings, x);
  }

  static Estimate from_exact(const Jet2d& jet) { return {jet, jet.value, 0}; }

  Scene scene;
  Settings settings;
  DirectRadianceSource source;
  std::optional<ScatteredRadiance> reference;
};

Model::Model(const SceneDescription& scene, const Settings& settings)
    : parts_(std::make_unique<const Parts>(scene, settings)) {}
Model::Model(Model&& other) noexcept = default;
Model::~Model() = default;

const Scene& Model::scene() const { return parts_->scene; }
const Settings& Model::settings() const { return parts_->settings; }

Estimate Model::estimate(const Vec2d& x) const {
  parts_->scene.check_point(x);
  Estimate sum;
  const auto add = [&sum](const Estimate& part) {
    sum.mean += part.mean;
    sum.stratified_mean += part.stratified_mean;
    sum.gradient_magnitude += part.gradient_magnitude;
    sum.rays += part.rays;
  };
  if (parts_->settings.order != Order::multiple) add(parts_->single(x));
  if (parts_->settings.order != Order::single) add(parts_->multiple(x));
  return sum;
}

}  // namespace fogbank::derivatives::flatland
