#include "derivatives/estimate_average.h"

#include <cmath>

#include "core/thread_time.h"

namespace fogbank::derivatives {

namespace {

void add_number(double& mean, double& squares, double value, double count) {
  const double before = value - mean;
  mean += before / count;
  squares += before * (value - mean);
}

}  // namespace

void EstimateAverage::Moments::add(const Jet3d& sample, double count) {
  add_number(mean.value, squares.value, sample.value, count);
  for (int i = 0; i < 3; ++i) add_number(mean.gradient[i], squares.gradient[i], sample.gradient[i], count);
  for (size_t i = 0; i < sample.hessian.entries.size(); ++i)
    add_number(mean.hessian.entries[i], squares.hessian.entries[i], sample.hessian.entries[i], count);
}

Jet3d EstimateAverage::Moments::standard_error(int32_t count) const {
  Jet3d error;
  if (count < 2) return error;
  const double scale = 1 / (static_cast<double>(count) * (count - 1));
  error.value = std::sqrt(squares.value * scale);
  for (int i = 0; i < 3; ++i) error.gradient[i] = std::sqrt(squares.gradient[i] * scale);
  for (size_t i = 0; i < error.hessian.entries.size(); ++i)
    error.hessian.entries[i] = std::sqrt(squares.hessian.entries[i] * scale);
  return error;
}

bool EstimateAverage::add(const Estimator& estimator, const Vec3f& x, const std::atomic<bool>& stop) {
  if (stop) return false;
  const double start = thread_cpu_seconds();
  RayCounters counters;
  counters.stop = &stop;
  RadianceJet sample;
  try {
    sample = estimator.estimate(x, static_cast<uint32_t>(count_), counters);
  } catch (const Interrupted&) {
    return false;
  }
  ++count_;
  for (size_t c = 0; c < 3; ++c) channels_[c].add(sample.channels[c], count_);
  luminance_.add(sample.luminance(), count_);
  samples_ += counters.total();
  seconds_ += thread_cpu_seconds() - start;
  return true;
}

PointEstimate EstimateAverage::result() const {
  PointEstimate result;
  for (size_t c = 0; c < 3; ++c) {
    result.mean.channels[c] = channels_[c].mean;
    result.standard_error.channels[c] = channels_[c].standard_error(count_);
  }
  result.luminance_standard_error = luminance_.standard_error(count_);
  result.samples = samples_;
  result.seconds = seconds_;
  return result;
}

PointEstimate average(const Estimator& estimator, const EstimatorSettings& settings, const Vec3f& x) {
  const std::atomic<bool> never = false;
  EstimateAverage average;
  for (int32_t repeat = 0; repeat < settings.repeats; ++repeat) average.add(estimator, x, never);
  return average.result();
}

}  // namespace fogbank::derivatives
