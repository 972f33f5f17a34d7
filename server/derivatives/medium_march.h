// Where the march along a ray looks at the medium: strata of distances, and a sample in each.
#pragma once

#include <vector>

#include "core/vector.h"

namespace fogbank::derivatives {

/// Ends of strata that begin at 0, ascending, the last one `extent` (> 0, finite). No stratum is longer than
/// `optical_step` mean free paths of the densest channel that still lets 1e-4 through, or than 1/`steps` of
/// the extent (method.md section 8.1); what lies behind the last channel's 1e-4 is one stratum.
/// `sigma_t` >= 0 per channel, 1/u.
std::vector<double> marching_strata(const Vec3d& sigma_t, double extent, double optical_step, int steps);

/// Fewest strata where every sample is dear and noisy. The first one ends at `first` (0: no such), for
/// derivatives, which weigh samples by up to their squared inverse distance; from there on each is thrice as
/// far as the one before, up to where it would hold more than 1/`count` of all importance, which is
/// transmittance, of equal weight for all channels. The rest is shared out in equal parts of at most that.
std::vector<double> importance_strata(const Vec3d& sigma_t, double extent, double first, int count);

struct DistanceSample {
  double distance = 0;
  double inverse_pdf = 0;  ///< u
};

/// Distance in [begin, end] drawn by transmittance: with a grey medium transmittance times `inverse_pdf` is
/// exactly its integral over the stratum. Channels that differ are mixed in equal parts and weighted by the
/// balance heuristic (Veach 1997, section 9.2.2). `u` is canonical.
DistanceSample sample_stratum(const Vec3d& sigma_t, double begin, double end, double u);

/// Integrals of s^n exp(-sigma_t s) over [0, length] for n = 0, 1, 2; sigma_t * length up to a few units, by
/// a Gauss-Legendre rule of 5 points (relative error below 1e-7 up to 1 unit).
struct NearIntegrals {
  double order0 = 0;
  double order1 = 0;
  double order2 = 0;
};
NearIntegrals near_integrals(double sigma_t, double length);

}  // namespace fogbank::derivatives
