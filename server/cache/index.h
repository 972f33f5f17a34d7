// Look-up: the blended, extrapolated radiance of all records whose extent holds a point.
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "cache/ellipsoid_tree.h"
#include "cache/metric.h"
#include "cache/record_set.h"

namespace fogbank::cache {

/// What the records say about a point.
struct Interpolation {
  Spectrum radiance{0};   ///< mean incoming radiance, finite, >= 0; 0 where no record reaches
  float weight = 0;       ///< sum of weights; 0: no record reaches
  float radius = 0;       ///< harmonic mean of the semi-axes of what counts, scene units; 0 where none does
  uint32_t records = 0;   ///< places that count
  uint32_t rejected = 0;  ///< places whose extent holds the point, yet with a surface between (guard 4)
};

/// Who knows for sure what depth bins know roughly.
class VisibilityTest {
 public:
  virtual ~VisibilityTest() = default;
  /// Is `point` in sight of a record at `place`? `normal`: unit, of the record's surface; 0 in a medium.
  virtual bool reaches(const Vec3f& place, const Vec3f& normal, const Vec3f& point) const = 0;
};

/// What one place contributes to a look-up.
struct Contribution {
  uint32_t place = 0;  ///< of the component, as RecordSet::place counts them
  float weight = 0;    ///< > 0
  float radius = 0;    ///< harmonic mean of the semi-axes of its extent, scene units
};

/// Records of one component for one threshold. Immutable: look-ups take no lock.
class Index {
 public:
  /// `range` belongs to `set`; `settings` are valid.
  Index(std::shared_ptr<const RecordSet> set, const ComponentRange& range, const MetricSettings& settings);

  /// Weights w = 3 d^2 - 2 d^3 with d = 1 - |W dx|, values max(0, M + g . dx) (method.md section 11), summed
  /// in the set's order: the same bits for the same set. Radiances count as no more than three times the
  /// record's, or the metric's floor where that is more: the metric's own caps keep luminances within
  /// twice, but not a channel that changes faster. Nothing counts as more than 1e30.
  /// Among records with a shape `scattered` says what to make of it, and values are what is scattered along
  /// a ray, per unit of sigma_s; null, and among others: mean radiance.
  Interpolation look_up(const Vec3f& point, const ScatteredDirection* scattered = nullptr) const;
  /// The same, to the bit, for several points, results[i] to points[i]. Up to eight in a row are looked up
  /// together where they lie close together compared with extents, as those of neighbouring pixels do:
  /// several times faster.
  void look_up(std::span<const Vec3f> points, std::span<Interpolation> results,
               const ScatteredDirection* scattered = nullptr) const;

  /// The places behind a look-up, with their weights: for showing and judging what it rests on. `normal`: 0
  /// in a medium. Not those that `recover_visible` finds.
  std::vector<Contribution> contributions(const Vec3f& point, const Vec3f& normal) const;
  /// The places behind what `recover_visible` makes of a look-up that has nothing but rejected records. Those
  /// of the few greatest weights only are asked about.
  std::vector<Contribution> recovered(const Vec3f& point, const Vec3f& normal,
                                      const VisibilityTest& visibility) const;
  /// Where `found`, what a look-up says about `point`, is nothing but rejected records, it becomes what those
  /// of them say that `visibility` lets through after all: depth bins are coarse and round down, so that in
  /// front of walls they reject most of what is in sight. `normal`: 0 in a medium.
  void recover_visible(const Vec3f& point, const Vec3f& normal, const VisibilityTest& visibility,
                       Interpolation& found, const ScatteredDirection* scattered = nullptr) const;
  /// What the records of a place say at `offset` from it, as look-ups count them.
  Spectrum extrapolated_by(uint32_t place, const Vec3f& offset,
                           const ScatteredDirection* scattered = nullptr) const;
  /// Harmonic mean of the semi-axes of the extent of `place`, on a surface of those along it; 0 where it
  /// holds nothing.
  float radius(uint32_t place) const;

  const ComponentRange& range() const { return *range_; }
  /// On a surface of unit `normal`, among records on surfaces: the cosine between the normals enters the
  /// distance, d = 1 - sqrt(|W dx|^2 + (1 - cosine) / (1 - similar_normals)), so that records fade out as the
  /// surface turns away from theirs and those of other sides of a corner or a wall never count.
  Interpolation look_up(const Vec3f& point, const Vec3f& normal) const;

  const Component& component() const { return range_->component; }
  /// Bytes that the index holds besides the set.
  size_t memory() const { return tree_.memory() + gradient_shares_.capacity() * sizeof(float); }

 private:
  struct Sums;
  struct SurfaceSums;
  void look_up_bundle(std::span<const Vec3f> points, Interpolation* results,
                      const ScatteredDirection* scattered) const;
  /// What a record says, number `record` in the set: as the set has it, or made in `room`.
  const Shading& shading(size_t record, const ScatteredDirection* scattered, Shading& room) const;
  void add_on_surface(const Vec3f& point, const Vec3f& normal, uint32_t place, Interpolation& result,
                      SurfaceSums& sums) const;
  Vec3f position(uint32_t place) const;
  float gradient_share(uint32_t place) const {
    return gradient_shares_.empty() ? 1.0f : gradient_shares_[place];
  }
  /// Squared distance in extents of a point at `offset`; 1 is the border. `normal`: 0 in a medium.
  float normalised_square(uint32_t place, const Vec3f& offset, const Vec3f& normal) const;
  /// Most that an extrapolation from `radiance` counts as.
  Spectrum ceiling(const Spectrum& radiance) const;
  /// Sum of reciprocals of the semi-axes, on a surface of those along it.
  float inverse_axes(uint32_t place) const;
  void add(const PointBundle& points, uint32_t place, const ScatteredDirection* scattered, Sums& sums) const;

  std::shared_ptr<const RecordSet> set_;
  const ComponentRange* range_;
  EllipsoidTree tree_;
  std::vector<float> gradient_shares_;  ///< by place, of its extent; empty where all are 1
  bool depth_guard_;
  /// MetricSettings::radiance_floor; infinite for ratios and the rival's quantities.
  float floor_ = 0;
  float greatest_ = 0;  ///< that a look-up may say
};

/// A set of records ready for look-ups at one threshold: an epoch as it is published.
class Epoch {
 public:
  /// Throws Error(invalid_argument, "INVALID_SETTINGS") as validate() does.
  Epoch(std::shared_ptr<const RecordSet> set, const MetricSettings& settings);

  const RecordSet& records() const { return *set_; }
  const MetricSettings& settings() const { return settings_; }
  /// Null where the set holds no record of it.
  const Index* find(const Component& component) const;
  /// Bytes of records and indices together.
  size_t memory() const;

 private:
  std::shared_ptr<const RecordSet> set_;
  MetricSettings settings_;
  std::vector<Index> indices_;  ///< ascending by component
};

}  // namespace fogbank::cache
