// Fills a two-dimensional cache where points ask for it, and looks all of them up.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "cache/flatland/cache.h"
#include "derivatives/flatland/model.h"

namespace fogbank::cache::flatland {

/// Most records of a fill; look-ups are linear in them.
inline constexpr int64_t largest_record_count = 1 << 14;

/// Record of a point, by the model's method. Its value is the triangulated sum where silhouettes are
/// bisected, else the stratified mean, which has no bias (method.md section 17).
Record make_record(const derivatives::flatland::Model& model, const Vec2d& x);

/// A fill in steps. The pilot, the first points, get a record each; 5 % of their mean radiance is the floor
/// that darker places count as. Then each point in turn that no record reaches gets one, over and over,
/// because new records shrink others' extents; a point that has a record is always reached, so this ends. At
/// last all points are looked up. A pure function of model, settings and points.
class Fill {
 public:
  /// 1 <= pilot <= points.size(); all points pass Scene::check_point(). Throws as validate() does.
  Fill(std::shared_ptr<const derivatives::flatland::Model> model, const Settings& settings,
       std::vector<Vec2d> points, size_t pilot);

  /// Goes on for `points` points. False when all is done. Throws Error(resource_exhausted,
  /// "TOO_MANY_RECORDS").
  bool advance(size_t points);

  const Cache& cache() const { return *cache_; }
  /// Of the points, in their order; complete after the last step.
  const std::vector<double>& radiance() const { return radiance_; }
  /// Rays of all records, those of the guards included.
  uint64_t rays() const { return rays_; }

 private:
  enum class Stage { pilot, fill, look_up, done };

  void step();
  void end_pilot();
  void add(const Vec2d& x);

  std::shared_ptr<const derivatives::flatland::Model> model_;
  Settings settings_;
  std::vector<Vec2d> points_;
  size_t pilot_;
  std::vector<Record> pilot_records_;
  std::optional<Cache> cache_;
  std::vector<double> radiance_;
  uint64_t rays_ = 0;
  Stage stage_ = Stage::pilot;
  size_t next_ = 0;
  size_t size_before_ = 0;  ///< records when this turn over all points began
};

}  // namespace fogbank::cache::flatland
