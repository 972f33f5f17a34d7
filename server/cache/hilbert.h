// Order of points along a Hilbert curve.
#pragma once

#include <cstdint>

#include "core/vector.h"

namespace fogbank::cache {

/// A cube around the origin, cut into 2^21 cells along each axis.
class HilbertCurve {
 public:
  /// `extent` is the greatest absolute coordinate; only its power of two matters, so that sets of about the
  /// same size have the same curve.
  explicit HilbertCurve(float extent);

  /// Number of the cell that holds `position` along the curve, below 2^63.
  uint64_t index(const Vec3f& position) const;

  friend bool operator==(const HilbertCurve&, const HilbertCurve&) = default;

 private:
  double cells_per_unit_;
};

}  // namespace fogbank::cache
