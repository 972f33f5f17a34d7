// What the noise of sources does to derivatives.
#pragma once

namespace fogbank::derivatives {

/// How uncertain derivatives of a luminance are: variances of all their entries, added up. Half the squared
/// difference of two neighbouring rays estimates the variance of each, and counts what differs between their
/// strata as noise, which is on the safe side.
struct DerivativeVariance {
  double gradient = 0;
  double hessian = 0;  ///< of all nine entries
};

}  // namespace fogbank::derivatives
