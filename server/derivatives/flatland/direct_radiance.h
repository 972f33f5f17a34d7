// Single scattering, exactly.
#pragma once

#include "derivatives/flatland/field_functions.h"
#include "derivatives/flatland/scene.h"
#include "derivatives/flatland/source.h"

namespace fogbank::derivatives::flatland {

/// M_surf of method.md section 1: mean radiance at x of the light that comes straight from the segments,
///   M = 1 / (2 pi) sum over visible intervals of the lights of L int exp(-sigma_t h / cos phi) dphi,
/// with h the distance of the light's line and phi the angle to its normal. The intervals end at vertices of
/// the scene, found by clipping against all segments; the integral is Gauss-Legendre quadrature in pieces, to
/// about 1e-13. As a jet: derivatives of that formula, interval ends moving with x, hence as exact as the
/// value (except on the lines where visibility changes, where there are none).
template <ScalarField Field>
Field direct_radiance(const Scene& scene, const Vec2d& x);

/// The medium lit by single scattering: the march then gives the next order.
class DirectRadianceSource final : public Source {
 public:
  explicit DirectRadianceSource(const Scene& scene) : scene_(scene) {}
  double value(const Vec2d& y) const override { return direct_radiance<double>(scene_, y); }
  Jet2d jet(const Vec2d& y) const override { return direct_radiance<Jet2d>(scene_, y); }
  /// Visibility changes on lines through two vertices only.
  std::vector<Line> creases() const override;

 private:
  const Scene& scene_;
};

}  // namespace fogbank::derivatives::flatland
