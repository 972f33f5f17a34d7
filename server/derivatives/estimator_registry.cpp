// The estimators by method name. A new one is its own file and one line here.
#include <chrono>
#include <cmath>

#include "core/error.h"
#include "derivatives/aware.h"
#include "derivatives/estimator.h"
#include "derivatives/finite_difference.h"
#include "derivatives/unaware.h"

namespace fogbank::derivatives {

namespace {

struct Entry {
  MethodInfo info;
  std::unique_ptr<Estimator> (*make)(std::shared_ptr<const transport::World> world,
                                     const EstimatorSettings& settings);
};

template <typename Method>
std::unique_ptr<Estimator> make(std::shared_ptr<const transport::World> world,
                                const EstimatorSettings& settings) {
  return std::make_unique<Method>(std::move(world), settings);
}

const std::vector<Entry>& entries() {
  static const std::vector<Entry> all{
      {{"aware", "triangulated surroundings: derivatives see what blocks light (Marco et al. 2018)"},
       make<Aware>},
      {{"unaware", "point-to-point kernels differentiated as if nothing could hide (Jarosz et al. 2008)"},
       make<Unaware>},
      {{"finite-difference",
        "differences of exactly visible direct light and of correlated paths: the slow reference"},
       make<FiniteDifference>},
  };
  return all;
}

/// Running mean and sum of squared deviations of every number of a jet (Welford 1962).
struct Moments {
  Jet3d mean;
  Jet3d squares;

  static void add(double& mean, double& squares, double value, double count) {
    const double before = value - mean;
    mean += before / count;
    squares += before * (value - mean);
  }
  void add(const Jet3d& sample, double count) {
    add(mean.value, squares.value, sample.value, count);
    for (int i = 0; i < 3; ++i) add(mean.gradient[i], squares.gradient[i], sample.gradient[i], count);
    for (size_t i = 0; i < sample.hessian.entries.size(); ++i)
      add(mean.hessian.entries[i], squares.hessian.entries[i], sample.hessian.entries[i], count);
  }
  /// Standard error of the mean of `count` samples; 0 for one.
  Jet3d standard_error(int32_t count) const {
    Jet3d error;
    if (count < 2) return error;
    const double scale = 1 / (static_cast<double>(count) * (count - 1));
    error.value = std::sqrt(squares.value * scale);
    for (int i = 0; i < 3; ++i) error.gradient[i] = std::sqrt(squares.gradient[i] * scale);
    for (size_t i = 0; i < error.hessian.entries.size(); ++i)
      error.hessian.entries[i] = std::sqrt(squares.hessian.entries[i] * scale);
    return error;
  }
};

void check_range(const char* field, int32_t value, int32_t lowest, int32_t highest) {
  if (value >= lowest && value <= highest) return;
  throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS",
              std::string(field) + ": " + std::to_string(value) + " is not in " + std::to_string(lowest) +
                  " .. " + std::to_string(highest));
}

}  // namespace

void validate(const EstimatorSettings& settings) {
  check_range("samples", settings.samples, EstimatorLimits::fewest_samples, EstimatorLimits::most_samples);
  check_range("repeats", settings.repeats, 1, EstimatorLimits::most_repeats);
  check_range("max_depth", settings.max_depth, -1, EstimatorLimits::path_depth);
}

PointEstimate average(const Estimator& estimator, const EstimatorSettings& settings, const Vec3f& x) {
  const std::atomic<bool> never = false;
  return *average(estimator, settings, x, never);
}

std::optional<PointEstimate> average(const Estimator& estimator, const EstimatorSettings& settings,
                                     const Vec3f& x, const std::atomic<bool>& stop) {
  const auto start = std::chrono::steady_clock::now();
  PointEstimate result;
  RayCounters counters;
  std::array<Moments, 3> channels;
  Moments luminance;
  for (int32_t repeat = 0; repeat < settings.repeats; ++repeat) {
    if (stop) return std::nullopt;
    const RadianceJet sample = estimator.estimate(x, static_cast<uint32_t>(repeat), counters);
    for (size_t c = 0; c < 3; ++c) channels[c].add(sample.channels[c], repeat + 1);
    luminance.add(sample.luminance(), repeat + 1);
  }
  for (size_t c = 0; c < 3; ++c) {
    result.mean.channels[c] = channels[c].mean;
    result.standard_error.channels[c] = channels[c].standard_error(settings.repeats);
  }
  result.luminance_standard_error = luminance.standard_error(settings.repeats);
  result.samples = counters.total();
  result.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return result;
}

std::unique_ptr<Estimator> make_estimator(const std::string& method,
                                          std::shared_ptr<const transport::World> world,
                                          const EstimatorSettings& settings) {
  validate(settings);
  std::string known;
  for (const Entry& entry : entries()) {
    if (entry.info.name == method) return entry.make(std::move(world), settings);
    known += (known.empty() ? "" : ", ") + entry.info.name;
  }
  throw Error(ErrorKind::invalid_argument, "UNKNOWN_METHOD",
              "there is no method \"" + method + "\"; known: " + known);
}

std::vector<MethodInfo> supported_methods() {
  std::vector<MethodInfo> infos;
  for (const Entry& entry : entries()) infos.push_back(entry.info);
  return infos;
}

}  // namespace fogbank::derivatives
