// How far a record may be extrapolated: the error metric of method.md section 10. The Hessian bounds the
// error of first-order extrapolation; the extent is the ellipsoid over which that error integrates to the
// threshold.
#pragma once

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "cache/eigen.h"
#include "cache/record_set.h"
#include "core/vector.h"

namespace fogbank::cache {

/// A camera's pixels seen from the medium: below their size nothing is gained by smaller extents.
struct PixelFootprint {
  Vec3f camera{0};        ///< its position
  float pixel_angle = 0;  ///< radians that a pixel spans
};

/// What radiance errors are relative to.
enum class Reference : uint8_t {
  local,     ///< max(luminance of the record, radiance_floor)
  constant,  ///< radiance_floor everywhere: least RMSE over an image (ratio-records.md section 3)
};

enum class Shape : uint8_t { ellipsoid, sphere };

/// Least cosine between normals of surface records that may stand in for each other.
inline constexpr float similar_normals = 0.9f;
/// Semi-axis across a surface over the shorter one along it: steps and the far sides of thin walls stay out,
/// curved surfaces and rounding in.
inline constexpr float surface_thickness = 0.05f;

/// Guards of method.md section 10.4 against what second-order derivatives can't see; all on in use, singly
/// off to show what each is for.
struct Guards {
  bool neighbour_clamp = true;
  bool visibility_margin = true;
  bool verify = true;
  bool depth = true;
};

struct MetricSettings {
  /// eps: the integral of the extrapolation error over an extent is threshold * reference radiance. Unit
  /// length^3 (eps_rel * ell^3 of method.md section 10.1). > 0.
  double threshold = 0;
  /// Of is_unaware() quantities, instead of the threshold: change of the radiance across a radius, relative
  /// to it, if all samples change alike. > 0.
  double first_order_change = 0.2;
  double radiance_floor = 0;  ///< > 0; in the unit of radiance
  double direct_floor = 1;    ///< the same for ratios, of what they stand for (as_radiance)
  Reference reference = Reference::local;
  Shape shape = Shape::ellipsoid;
  double maximum_anisotropy = 3;           ///< ratio of the longest to the shortest semi-axis, 1 to 1e4
  double maximum_radius = 0;               ///< > 0, scene units
  double minimum_radius = 0;               ///< >= 0, scene units; beats every clamp and guard
  std::vector<PixelFootprint> footprints;  ///< of the cameras that matter
  double minimum_pixels = 1.5;             ///< minimum radius, in pixels of the nearest footprint; >= 0
  Guards guards;
};

/// Throws Error(invalid_argument, "INVALID_SETTINGS") naming the field.
void validate(const MetricSettings& settings);

/// Semi-axes a_i of the largest extent with error integral `budget` (threshold times reference radiance) for
/// curvatures `eigenvalues` of the Hessian, each a_i at most caps[i]: on the level set |lambda_i| a_i^2 = k
/// where no cap binds, with k such that the true integral is the budget (method.md sections 10.1 and 10.2).
/// Eigenvalues count as at least the greatest over maximum_anisotropy^2. If the caps alone keep within budget
/// they are the result. Dim = 2 or 3.
template <int Dim>
std::array<double, static_cast<size_t>(Dim)> level_set_semi_axes(
    const std::array<double, static_cast<size_t>(Dim)>& eigenvalues, double budget,
    const std::array<double, static_cast<size_t>(Dim)>& caps, double maximum_anisotropy);

/// Radius of the ball with that error integral (method.md section 10.1); infinite where all eigenvalues are
/// 0.
template <int Dim>
double ball_radius(const std::array<double, static_cast<size_t>(Dim)>& eigenvalues, double budget);

/// Integral of the bound sum |lambda_i| u_i^2 / 2 over the ellipsoid.
template <int Dim>
double error_integral(const std::array<double, static_cast<size_t>(Dim)>& eigenvalues,
                      const std::array<double, static_cast<size_t>(Dim)>& semi_axes);

struct Ellipsoid {
  std::array<Vec3f, 3> axes{};  ///< orthonormal
  std::array<float, 3> semi_axes{};
  /// Of a record's gradient, to extrapolate by; 1 but where the minimum radius makes the extent larger than
  /// metric and guards would. 0 to 1.
  float gradient_share = 1;

  /// Semi-axes times `scale`, at most `greatest`, at least `least`.
  Ellipsoid clamped(float scale, float greatest, float least) const;
  float longest() const;
  float shortest() const;
  /// An extent on a surface, whose third axis is the normal: semi-axes kept but for that one, which follows
  /// from the others by `surface_thickness`.
  Ellipsoid flat() const;
  /// Thinner than the least normal float: holds no point, not even its centre.
  bool empty() const { return shortest() < std::numeric_limits<float>::min(); }
  /// Half extents of the axis-aligned box around it: sqrt(sum a_k^2 e_k,i^2).
  Vec3d half_extents() const;
  /// W with |W d|^2 < 1 inside; NaN where empty().
  Symmetric3d inverse_root() const;
};

/// eps of extents on surfaces, unit length^2: the one that admits the same error at the border of a disk of
/// 0.4 maximum_radius as `threshold` does at that of a ball (4 eps / (pi R^2) against 15 eps / (4 pi R^3)).
double surface_threshold(const MetricSettings& settings);

/// Reference radiance of a place, > 0.
double reference_radiance(const MetricSettings& settings, double luminance);

/// Smallest radius at `position`: minimum_radius, or minimum_pixels in the nearest footprint if that is
/// larger.
float minimum_radius(const MetricSettings& settings, const Vec3f& position);

/// Radiance that a record claims where linear extrapolation changes it by `change`, one channel, >= 0: linear
/// (method.md section 11) or, of is_unaware() quantities, the logarithm's (Jarosz et al. 2008), which may
/// brighten at most fourfold, because below the minimum radius nothing else bounds it.
float extrapolated(Quantity quantity, float radiance, float change);

/// What a ratio stands for near its place, with the proxy as it is there (ratio-records.md section 1: the
/// error in M is Mhat times that of rho); other quantities as they are.
Place as_radiance(Place place);

/// Extent of a place by itself, on a surface (Place::normal) of two dimensions and flat across: metric,
/// maximum radius, cap by the gradient (extrapolation stays positive), visibility margin. Guards that need
/// neighbours and the minimum radius come after (extents.h).
Ellipsoid base_ellipsoid(const MetricSettings& settings, const Place& place);

}  // namespace fogbank::cache
