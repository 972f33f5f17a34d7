// The mean of independent estimates at a point, in the making.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

#include "derivatives/estimator.h"

namespace fogbank::derivatives {

/// Can be left after any estimate and gone on with in another thread.
class EstimateAverage {
 public:
  /// Makes the next estimate at `x`, the same for every call, and adds it. Returns false, with nothing added,
  /// when `stop` is set.
  bool add(const Estimator& estimator, const Vec3f& x, const std::atomic<bool>& stop);
  /// Estimates so far.
  int32_t count() const { return count_; }
  /// `count` >= 1.
  PointEstimate result() const;

 private:
  /// Running mean and sum of squared deviations of every number of a jet (Welford 1962).
  struct Moments {
    Jet3d mean;
    Jet3d squares;

    void add(const Jet3d& sample, double count);
    /// Standard error of the mean of `count` samples; 0 for one.
    Jet3d standard_error(int32_t count) const;
  };

  std::array<Moments, 3> channels_;
  Moments luminance_;
  int32_t count_ = 0;
  uint64_t samples_ = 0;
  double seconds_ = 0;
};

}  // namespace fogbank::derivatives
