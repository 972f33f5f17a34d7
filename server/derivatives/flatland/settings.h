// What is asked of the two-dimensional model, and its answer.
#pragma once

#include <cstdint>

#include "derivatives/estimator.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives::flatland {

enum class Method : uint8_t {
  exact,    ///< clipping and quadrature: the reference
  unaware,  ///< point-to-point derivatives without visibility, method.md section 9
  aware,    ///< sorted ring of directions joined to segments, method.md sections 2 to 8
};

/// The defaults are the scheme with all its corrections; all options off is the plain scheme of the talk that
/// method.md describes.
struct Settings {
  Method method = Method::aware;
  Order order = Order::both;
  int32_t samples = 256;  ///< directions, one in each of as many equal strata
  uint64_t seed = 0;
  // Of the aware method:
  int32_t bisections = 8;  ///< of a gap between different surfaces (6.2); 0: none
  bool mean_rule = true;   ///< mean of both ends instead of the farthest, within a surface (section 5)
  bool sliding = true;     ///< linear extension beyond silhouettes (6.4 a), also of marched light
  bool ratio = false;      ///< derivatives scaled by stratified mean / triangulated value, per light (6.1)
  bool subtract = true;    ///< the source at the point is subtracted and treated in closed form (8.3)
  bool obliquity = true;   ///< path lengths through a shell in the Hessian (8.3)
  /// Step of marches through the medium, units; 0: min(0.25 / sigma_t, diagonal / 32), halved for each
  /// fourfold of samples above 64, as far as the limit of march points allows.
  double march_step = 0;
};

struct Estimate {
  Jet2d mean;  ///< mean radiance; of the aware method: of the triangulated directions
  /// Monte Carlo mean of the same rays, free of the triangulation's bias (6.1); of the exact method: the
  /// value.
  double stratified_mean = 0;
  /// Mean of the magnitudes of the single samples' gradients, of the unaware method alone: what its
  /// first-order radius follows from (method.md section 9). At least |mean.gradient|.
  double gradient_magnitude = 0;
  uint64_t rays = 0;
};

}  // namespace fogbank::derivatives::flatland
