// The estimators by method name. A new one is its own file and one line here.
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
