// Lines of sight from one point of a medium: what solid surface ends each, what lies in between, and the
// transmittance with its derivatives with respect to the point.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/random.h"
#include "core/ray_counters.h"
#include "derivatives/media_path.h"
#include "transport/world.h"

namespace fogbank::derivatives {

/// A surface on a line that light goes straight through.
struct Crossing {
  float distance = 0;
  Vec3f normal{0, 0, 1};         ///< geometric
  int32_t medium = scene::none;  ///< beyond it
  Spectrum through{1};           ///< what this surface and those before it let through; >= 0
};

/// A bundle of lines of sight from one point. Reusable; a bundle is for one thread. Every line begins in the
/// same medium; one that stays in it costs no more than its ray.
class Sightlines {
 public:
  /// `world` must outlive this. `medium` holds `origin` (scene::none: vacuum).
  explicit Sightlines(const transport::World& world) : world_(world) {}

  /// Forgets all lines.
  void start(const Vec3f& origin, int32_t medium);

  /// Adds lines in unit `directions`, best in an order in which neighbours are close: they are traced in
  /// packets. Surfaces are looked for up to `max_distances`, one for each line or one for all. Returns the
  /// index of the first.
  /// `stops`: at a surface that reflects as well as it lets light through, a line ends with the probability
  /// 1 - (share let through), and its `factor` makes up for it; null: it goes on. Throws Interrupted.
  size_t append(std::span<const Vec3f> directions, std::span<const float> max_distances,
                RayCounters& counters, RandomStream* stops = nullptr);
  /// Lines to points of lights: surfaces are looked for up to just before the point, as World::visibility
  /// does, so that the light itself is not in the way. `relative` = point - origin, of positive length.
  size_t append_to_points(std::span<const Vec3d> relative, RayCounters& counters);

  size_t size() const { return directions_.size(); }
  const transport::World& world() const { return world_; }
  const Vec3f& origin() const { return origin_; }
  int32_t medium() const { return medium_; }
  const Vec3f& direction(size_t line) const { return directions_[line]; }
  std::span<const Vec3f> directions() const { return directions_; }
  /// To the surface that ends the line, which lets nothing through; infinity where there is none.
  float distance(size_t line) const { return hits_[line].distance; }
  bool is_blocked(size_t line) const { return std::isfinite(hits_[line].distance); }
  /// Meaningful where is_blocked(); its distance counts from the origin.
  const scene::Hit& hit(size_t line) const { return hits_[line]; }
  /// Everything known of the surface that ends the line.
  scene::SurfaceInteraction surface(size_t line) const;
  /// Surfaces that let light through, nearest first, before the line's end.
  std::span<const Crossing> crossings(size_t line) const {
    const Passage& passage = passages_[line];
    return {crossings_.data() + passage.first, passage.count};
  }
  /// Medium at the line's far end.
  int32_t last_medium(size_t line) const {
    return passages_[line].count == 0 ? medium_ : crossings(line).back().medium;
  }
  /// What all crossings let through.
  Spectrum factor(size_t line) const {
    return passages_[line].count == 0 ? Spectrum(1) : crossings(line).back().through;
  }

  /// Transmittance, `factor` included, from the origin to `distance` (beyond all crossings; may be infinite).
  Spectrum transmittance(size_t line, float distance) const;

  /// What lies along a line up to its end, for transmittances as jets.
  MediaPath path(size_t line) const;
  /// Does the line leave its first medium for one with another extinction?
  bool changes_medium(size_t line) const;

 private:
  struct Passage {
    uint32_t first = 0;
    uint32_t count = 0;
  };

  /// Lines first, first + 1, ..., whose directions are known.
  void trace(size_t first, size_t count, std::span<const float> max_distances, RayCounters& counters,
             RandomStream* stops);
  void cross(size_t line, const scene::Hit& first_hit, float limit, RayCounters& counters,
             RandomStream* stops);

  const transport::World& world_;
  Vec3f origin_{0};
  int32_t medium_ = scene::none;
  std::vector<Vec3f> directions_;
  std::vector<scene::Hit> hits_;
  std::vector<Passage> passages_;
  std::vector<Crossing> crossings_;
  std::vector<scene::Hit> passing_hits_;  ///< scratch of trace
  std::vector<float> limits_;             ///< scratch of trace
};

/// Transmittance between `origin` and each of origin + `relative`, 0 where something solid is in between:
/// World::visibility for a bundle, in packets of any-hit queries. `transmittances` has one entry a point.
void visibility(const transport::World& world, const Vec3f& origin, int32_t medium,
                std::span<const Vec3d> relative, std::span<Spectrum> transmittances, RayCounters& counters);

}  // namespace fogbank::derivatives
