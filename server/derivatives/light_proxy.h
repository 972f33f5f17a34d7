// What a light would bring to a point if nothing were in the way, in closed form: the proxy Mhat of
// ratio-records.md section 1.
#pragma once

#include <optional>
#include <vector>

#include "derivatives/radiance_jet.h"
#include "transport/plan.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// Mean radiance (fluence / 4 pi) from one light of constant radiance through a homogeneous medium without
/// surfaces. Immutable; safe from any thread.
class LightProxy {
 public:
  /// Of light `light` for points inside `medium`; nullopt for kinds without a closed form: images, textured
  /// lights, cylinders, meshes of several triangles, lights without extent. Where surfaces that bound media
  /// may lie between the light and points around it the medium is left out, so that the proxy bounds what
  /// arrives from above.
  static std::optional<LightProxy> make(const transport::World& world, const transport::Plan& plan,
                                        uint32_t light, int32_t medium);

  /// Mhat at `x`; 0 behind one-sided lights and inside round ones. Relative error about 1e-5.
  Spectrum value(const Vec3f& x) const;
  /// Mhat, gradient and Hessian. Points nearer to the light than `least_distance` count as that far away.
  RadianceJet jet(const Vec3d& x, double least_distance) const;
  /// Of the light itself.
  const Spectrum& radiance() const { return radiance_; }
  /// Upper bound of M / Mhat for any visibility: exp(sigma_t * half diagonal of a piece), times 1 + 1e-3 for
  /// rounding and for outlines of round lights.
  float greatest_ratio() const { return greatest_ratio_; }
  /// Lights with a greater bound have no proxy: disks and triangles, which are one piece, in thick media.
  static constexpr float most_ratio = 1.5f;

 private:
  /// Flat and convex, in one plane; counter-clockwise seen from the emitting side.
  struct Piece {
    std::vector<Vec3f> vertices;
    Vec3f center{0};
  };
  struct Ball {
    Vec3f center{0};
    float radius = 0;
  };

  void split_rectangle(const transport::RectangleShape& shape);
  void split_disk(const transport::DiskShape& shape);

  Spectrum radiance_{0};
  Spectrum sigma_t_{0};
  Vec3f normal_{0};  ///< of flat lights
  std::vector<Piece> pieces_;
  std::optional<Ball> ball_;
  float greatest_ratio_ = 1;
};

}  // namespace fogbank::derivatives
