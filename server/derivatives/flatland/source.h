// Where the marches of multiple scattering take the medium's own light from.
#pragma once

#include <vector>

#include "derivatives/flatland/scene.h"
#include "derivatives/jet.h"

namespace fogbank::derivatives::flatland {

/// q(y) of method.md sections 1 and 8: mean radiance (fluence / 2 pi) at points of the medium. Times sigma_s
/// it is what the medium sends out.
class Source {
 public:
  virtual ~Source() = default;
  virtual double value(const Vec2d& y) const = 0;
  /// With exact derivatives; only the reference asks for them.
  virtual Jet2d jet(const Vec2d& y) const = 0;
  /// Lines that hold all points where `jet` is not smooth, other than on the scene's surfaces.
  virtual std::vector<Line> creases() const = 0;
};

}  // namespace fogbank::derivatives::flatland
