// Which records a medium has, by its phase function.
#pragma once

#include <optional>
#include <vector>

#include "cache/record.h"
#include "integrators/integrator.h"
#include "transport/world.h"

namespace fogbank::integrators {

/// Which records a picture's fog is made of.
struct CacheTechnique {
  /// Derivatives see occlusion; single scattering has techniques of its own. False: the rival, after Jarosz
  /// et al. 2008, whose records hold single scattering as well, apart.
  bool aware = true;

  /// Of light that was scattered or reflected before; nothing where the medium scatters none or its phase
  /// function is too narrow: paths take the records' place.
  std::optional<cache::Quantity> rest(const transport::MediumInfo& medium) const;
  /// Of light straight from the emitters; nothing: SingleScatteringTerm finds it.
  std::optional<cache::Quantity> direct(const transport::MediumInfo& medium) const;
};

/// What media with anisotropic phase functions get, and why; those whose phase function is isotropic go
/// without saying.
std::vector<Decision> medium_decisions(const transport::World& world, const CacheTechnique& technique);

}  // namespace fogbank::integrators
