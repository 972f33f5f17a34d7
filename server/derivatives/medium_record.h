// What one gather of a medium's light has collected, and the derivatives of that.
#pragma once

#include "derivatives/medium_gather.h"
#include "derivatives/medium_shells.h"

namespace fogbank::derivatives {

/// A look at the medium's source along a ray.
struct MediumSample {
  double distance = 0;
  uint32_t stretch = 0;
  /// In the first stratum around the point, which derivatives see through MediumRecord::nearby.
  bool near = false;
  Vec3d weight{0};  ///< sigma_s times transmittance over the distance's density
  /// q, whose derivatives stand for those of `scattered`: what depends on the direction of sight turns with
  /// the point and has little of a gradient of its own, while taken for sources that are fixed in the world
  /// it would seem to have a steep one.
  Vec3d source{0};
  Vec3d scattered{0};  ///< what is sent to the point, per unit of sigma_s; equal to q if that is isotropic
};

/// The source close to the point, along one ray: the outermost sample of the first stratum, at `distance`,
/// standing for all of it, up to `length`. 0 all where there is none.
struct NearbySample {
  double distance = 0;
  double length = 0;
  Vec3d source{0};
};

/// Lines of sight of one point with everything that was seen along them.
struct MediumRecord {
  const transport::World& world;
  Vec3f x{0};
  std::span<const MediumRay> rays;
  std::span<const std::array<uint32_t, 3>> triangles;
  std::vector<RayOutline> outlines;  ///< ascending by their pairs of rays
  double far = 0;                    ///< ends farther away, and none, count as this far
  double least = 0;                  ///< ends nearer than this count as this near
  /// Of the medium around the point.
  int32_t medium = scene::none;
  Vec3d sigma_t{0};
  Vec3d sigma_s{0};
  std::vector<MediumSample> samples;  ///< ray after ray
  std::vector<size_t> first;          ///< of each ray, and the end of the last
  std::vector<NearbySample> nearby;   ///< of each ray; empty where the medium doesn't scatter
  /// The linear source of each channel that the samples are measured against: its value at the point (q0
  /// of method.md section 8.3) and its gradient.
  Vec3d constant{0};
  std::array<Vec3d, 3> slope{};

  MediumRecord(const transport::World& the_world, const Vec3f& point, std::span<const MediumRay> the_rays,
               std::span<const std::array<uint32_t, 3>> the_triangles,
               std::span<const RayOutline> the_outlines);

  double end(double distance) const { return std::clamp(distance, least, far); }
  /// Of the stretch that begins at the point.
  double first_end(size_t ray) const { return end(rays[ray].stretches.front().end); }
  std::span<const MediumSample> samples_of(size_t ray) const {
    return std::span(samples).subspan(first[ray], first[ray + 1] - first[ray]);
  }
  /// What one ray brings.
  Vec3d value_along(size_t ray) const;
  /// Stratified mean over the rays.
  Vec3d value() const;
  /// Gradient and Hessian of all channels; values are those of the triangulation, which is biased. Adds the
  /// variance of those of the luminance to `variance`. Throws Interrupted.
  RadianceJet derivatives(DerivativeVariance& variance, const RayCounters& counters) const;

 private:
  struct PathBeyond;

  /// Source of a channel at `distance` along a ray, beyond the linear one.
  double excess(const Vec3d& source, size_t ray, double distance, int channel) const {
    return source[channel] - constant[channel] -
           glm::dot(slope[static_cast<size_t>(channel)], rays[ray].direction) * distance;
  }
  /// The same of a sample, weighted.
  double excess(const MediumSample& sample, size_t ray, int channel) const {
    return sample.weight[channel] * (sample.stretch == 0
                                         ? excess(sample.source, ray, sample.distance, channel)
                                         : sample.source[channel]);
  }
  /// What each ray's vertex, at `distance(ray)`, gets of the form factors of the triangles around it: a third
  /// of those whose corners are all joined.
  template <typename Distance, typename Joined>
  std::vector<Jet3d> vertex_forms(const Distance& distance, const Joined& joined,
                                  const RayCounters& counters) const;
  RadianceJet linear_source(const Vec3d& vertex) const;
  const RayOutline* outline(uint32_t a, uint32_t b) const;
  /// The same where it parts the ends of first stretches too: not where both end at boundaries of the medium.
  const RayOutline* first_outline(uint32_t a, uint32_t b) const;
  bool is_cut(const std::array<uint32_t, 3>& triangle) const;
  /// Point, on a shell at `distance`, between a ray that has ended and one that hasn't.
  Vec3d shell_outline(uint32_t ended, uint32_t passing, double distance) const;
  /// What the samples of a ray up to `until` contribute to shells that nothing cuts.
  ShellMoments<double> moments(size_t ray, double until, int channel) const;
  /// The linear part of the medium around the point: closed forms.
  void add_linear(RadianceJet& sum, const RayCounters& counters) const;
  /// Samples beyond the nearest end of a triangle that outlines cut, ray by ray.
  void add_cut_shells(const std::array<uint32_t, 3>& triangle, const std::array<Vec3d, 3>& directions,
                      std::span<RadianceJet> along) const;
};

}  // namespace fogbank::derivatives
