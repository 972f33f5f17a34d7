// The interface of everything that answers "mean incoming radiance at a point, with gradient and Hessian".
// One file per method, one line in estimator_registry.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/ray_counters.h"
#include "derivatives/radiance_jet.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Which light arrives at the point: from surfaces, emitters and environments included (its last stretch
/// begins on a surface: "single", M_surf in method.md section 1), from the medium (M_med), or from both,
/// which is everything.
enum class Order : uint8_t { single, multiple, both };

/// Ranges of the settings.
struct EstimatorLimits {
  static constexpr int32_t fewest_samples = 16;
  static constexpr int32_t most_samples = 1 << 20;
  static constexpr int32_t most_repeats = 1024;
  static constexpr int32_t path_depth = 1 << 20;  ///< of max_depth
};

struct EstimatorSettings {
  Order order = Order::both;
  DerivativeOrder derivatives = DerivativeOrder::hessian;
  /// Directions of the sphere grid; rounded to the next even square n^2, n >= 4. Light grids follow it:
  /// method.md section 17 (1024 directions: 8 x 8 cells a light).
  int32_t samples = 1024;
  /// Independent estimates that are averaged; their spread is the standard error. At least 2 for one.
  int32_t repeats = 4;
  int32_t max_depth =
      -1;  ///< edges of a whole path camera-medium-...-light, as IntegratorSettings; -1: unbounded
  /// Count light that comes straight from emitters; false where it is sampled elsewhere.
  bool emission = true;
  bool bisect = true;  ///< silhouettes, method.md section 6.2
  /// Terms of the Hessian without which it doesn't converge in penumbrae, method.md section 6.4: sliding (a)
  /// and T-junctions (b). On: they cost no rays, and without (b) the Hessian of a small round light is all
  /// but missed (tests/bench/derivatives_comparison.cpp).
  bool sliding = true;
  bool corners = true;
  /// Terms that the scene doesn't need are left out (transport/plan.h). False computes them all: the same
  /// result up to rounding, for measuring what leaving out saves.
  bool leave_out = true;
  uint64_t seed = 0;
};

/// Throws Error(invalid_argument, "INVALID_SETTINGS"); the message begins with the field's name and a colon.
void validate(const EstimatorSettings& settings);

/// What an estimator found at a point.
struct PointEstimate {
  RadianceJet mean;
  /// Standard error of every number in `mean`; NaN-free: 0 where repeats == 1 leaves it unknown.
  RadianceJet standard_error;
  /// Standard error of `mean.luminance()`'s entries (channels are correlated, so it doesn't follow from
  /// theirs).
  Jet3d luminance_standard_error;
  uint64_t samples = 0;  ///< rays traced
  double seconds = 0;    ///< of this thread
};

/// Immutable; one instance serves all threads.
class Estimator {
 public:
  virtual ~Estimator() = default;
  /// One independent estimate at `x`; `repeat` selects its random numbers. A pure function of (world,
  /// settings, x, repeat). Finite always. Lengths that are 0 (x on a surface) count as the smallest that
  /// method.md section 4.5 allows. Throws Interrupted soon after `counters.stop` was set.
  virtual RadianceJet estimate(const Vec3f& x, uint32_t repeat, RayCounters& counters) const = 0;
};

/// Averages `settings.repeats` estimates.
PointEstimate average(const Estimator& estimator, const EstimatorSettings& settings, const Vec3f& x);

/// Throws Error(invalid_argument, "UNKNOWN_METHOD") naming the known ones, and as `validate`.
std::unique_ptr<Estimator> make_estimator(const std::string& method,
                                          std::shared_ptr<const transport::World> world,
                                          const EstimatorSettings& settings);

struct MethodInfo {
  std::string name;
  std::string summary;
};
std::vector<MethodInfo> supported_methods();

}  // namespace fogbank::derivatives
