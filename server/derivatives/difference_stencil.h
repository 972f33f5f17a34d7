// Central differences for gradient and Hessian of a function of three variables that is evaluated in single
// precision positions, with the step chosen by halving.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "core/random.h"
#include "derivatives/radiance_jet.h"

namespace fogbank::derivatives {

/// Several estimates of the same three numbers at one point, made with the same random numbers everywhere:
/// one for functions without noise.
using ValueBatches = std::vector<Vec3d>;
using ValueFunction = std::function<ValueBatches(const Vec3d& x)>;

struct StepChoice {
  double first = 0;  ///< step to begin with, scene units, > 0
  int32_t most_halvings = 0;
  /// Relative change of a derivative under halving that is good enough.
  double tolerance = 1e-4;
};

/// Value, gradient and Hessian (as `derivatives` asks) at x, channel by channel.
///
/// The stencil has 13 points: x, and six pairs x +- d in the directions of three axes and their sums, turned
/// at random by `random` so that repeats see different truncation errors. All points are multiples of one
/// power of two for each coordinate, so that single precision holds them, and differences, exactly; x moves
/// by less than its own rounding for that. Halving goes on until a derivative changes by less than the
/// tolerance or less than three standard errors of the change; then two steps without noise are extrapolated
/// to 0 (Richardson), and of two noisy ones the larger step is kept. Gradient and Hessian choose apart; what
/// never settles is taken where it changed least.
RadianceJet central_differences(const ValueFunction& function, const Vec3d& x, const StepChoice& steps,
                                bool with_hessian, RandomStream& random);

}  // namespace fogbank::derivatives
