// Light that the medium sends to a point: M_med of method.md section 8, with gradient and Hessian, by
// marching along the rays of a direction grid.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/random.h"
#include "core/ray_counters.h"
#include "derivatives/derivative_variance.h"
#include "derivatives/estimator.h"
#include "derivatives/source.h"

namespace fogbank::derivatives {

/// A piece of a ray inside one medium, or in vacuum.
struct MediumStretch {
  int32_t medium = scene::none;
  double begin = 0;
  double end = 0;  ///< infinity for the last one of a ray that hits nothing
  Vec3d normal{0, 0,
               1};      ///< of the boundary at `begin`, unit; unused for the stretch that begins at the point
  Spectrum through{1};  ///< what the surfaces up to `begin` let through
};

/// A direction of the grid with what lies along it.
struct MediumRay {
  Vec3d direction{0, 0, 1};  ///< unit
  double end = 0;            ///< distance of the surface that ends the ray; infinity where there is none
  std::vector<MediumStretch> stretches;  ///< from the point on, without gaps, up to `end`
};

/// An edge of the triangulation whose rays end on surfaces that don't meet between them: the outline of the
/// nearer one crosses it, in a direction found by bisection (method.md section 6.2). Without that, it is the
/// near ray's own, which makes derivatives close to silhouettes wrong by the order of the grid's spacing.
struct RayOutline {
  uint32_t near = 0;  ///< the ray that ends on the surface whose outline it is
  uint32_t far = 0;
  Vec3d point{0};   ///< on that surface, relative to the rays' origin
  Vec3d behind{0};  ///< in the same direction on what the far ray's first stretch ends at
};

struct MediumRecord;

struct MediumGatherSettings {
  /// Longest strata in mean free paths (method.md section 17).
  double optical_step = 0.25;
  /// March of sources that are free of noise: strata in the longest way.
  int32_t steps = 32;
  /// Strata of sources whose every sample is a noisy path: none holds more than this share of a ray's
  /// importance. The noise of the Hessian grows as the inverse length of the first one, for all of them
  /// together it falls only as the square root (method.md section 8.3).
  int32_t noisy_strata = 4;
  /// The first of those ends at this share of the mean way to a surface, unless that is more than
  /// `optical_step`: what the source does within is taken for quadratic.
  double noisy_first = 0.125;
};

/// Gathers for one world and source; immutable, one instance serves all threads.
class MediumGather {
 public:
  MediumGather(const transport::World& world, const MediumSource& source,
               const MediumGatherSettings& settings = {})
      : world_(world), source_(source), settings_(settings) {}

  /// Mean radiance that arrives at `x` from the medium along `rays`, which stand for equal solid angles and
  /// begin in the same medium: the stratified mean, unbiased. Derivatives are of the light that `triangles`
  /// (indices into `rays`, a closed triangulation of the sphere, r1 . (r2 x r3) > 0 but for inverted ones)
  /// hold together, ends of neighbours being joined but for `outlines`, which come in any order; they are
  /// 0 unless `order` asks for them. Finite. `arriving`, one a ray or empty, is what arrives along each;
  /// `variance`, or null, what the noise of sources does to derivatives.
  RadianceJet gather(const Vec3f& x, std::span<const MediumRay> rays,
                     std::span<const std::array<uint32_t, 3>> triangles, std::span<const RayOutline> outlines,
                     DerivativeOrder order, RandomStream& random, RayCounters& counters,
                     std::span<Vec3d> arriving = {}, DerivativeVariance* variance = nullptr) const;

 private:
  void march(MediumRecord& record, RandomStream& random, RayCounters& counters) const;
  /// Places samples; what the source is there, `look` finds.
  void march_stretch(MediumRecord& record, size_t ray, size_t stretch, std::span<const double> ends,
                     double phase) const;
  /// Samples the source where record.samples from number `first` on lie, all along one ray.
  void look(MediumRecord& record, size_t ray, size_t first, RandomStream& random,
            RayCounters& counters) const;
  /// Determines the linear source that samples are measured against.
  void subtract_linear_source(MediumRecord& record, RandomStream& random, RayCounters& counters) const;

  const transport::World& world_;
  const MediumSource& source_;
  MediumGatherSettings settings_;
};

}  // namespace fogbank::derivatives
