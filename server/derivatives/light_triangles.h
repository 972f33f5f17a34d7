// Wholly visible triangles of a light: form factor times transmittance times radiance.
#pragma once

#include "derivatives/estimator.h"
#include "derivatives/light_grid.h"
#include "derivatives/media_path.h"
#include "derivatives/radiance_jet.h"

namespace fogbank::derivatives {

/// A point of the light, relative to x, with the transmittance to it.
struct LightVertex {
  Vec3d position{0};
  RadianceJet transmittance;
};

/// Sums triangles of one grid.
class LightTriangles {
 public:
  /// `sigma_t`: of the medium around x, 1/length.
  LightTriangles(const LightGrid& grid, const Spectrum& sigma_t, DerivativeOrder order)
      : grid_(grid), order_(order) {
    medium_.sigma_t = sigma_t;
  }

  /// Form factor of a triangle on the light; lights at infinity have no parallax.
  Jet3d form_factor(const Vec3d& a, const Vec3d& b, const Vec3d& c) const;
  /// A weighted field of the same shape in all channels but for the transmittance.
  static void add(const Jet3d& field, const RadianceJet& transmittance, const Spectrum& radiance,
                  RadianceJet& sum);
  /// `in_one_medium`: the medium around x reaches to all of the triangle and absorbs, so that the
  /// transmittance is known everywhere on it: cells wider than 0.2 rad are then split (ratio-records.md
  /// section 2.2), and the middle of the triangle counts 3/4, which makes the mean exact to second order.
  /// Otherwise it is the mean of the vertices (method.md section 5).
  void add_triangle(const LightVertex& a, const LightVertex& b, const LightVertex& c, bool in_one_medium,
                    const Spectrum& radiance, RadianceJet& sum) const;

 private:
  void split(const LightVertex& from, const LightVertex& to, const LightVertex& opposite,
             const Spectrum& radiance, int splits, RadianceJet& sum) const;
  void add_in_medium(const LightVertex& a, const LightVertex& b, const LightVertex& c,
                     const Spectrum& radiance, int splits, RadianceJet& sum) const;

  const LightGrid& grid_;
  MediaPath medium_;  ///< around x, without an end
  DerivativeOrder order_;
};

/// Adds grid.unoccluded, seen through a medium of extinction `sigma_t` (1/length).
void add_unoccluded(const LightGrid& grid, const Spectrum& sigma_t, DerivativeOrder order,
                    const RayCounters& counters, RadianceJet& sum);

RadianceJet mean_of(const RadianceJet& a, const RadianceJet& b);

}  // namespace fogbank::derivatives
