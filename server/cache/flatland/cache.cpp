#include "cache/flatland/cache.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace fogbank::cache::flatland {

void Cache::add(const Record& record) {
  Extent extent;
  extent.base = base_ellipse(settings_, radiance_floor_, record);
  extent.bound = extent.base.longest();
  records_.push_back(record);
  extents_.push_back(extent);
  const size_t added = records_.size() - 1;
  for (size_t i = 0; i < added; ++i) {
    guard(i, added);
    guard(added, i);
    apply(extents_[i]);
  }
  apply(extents_[added]);
}

/// What record i has to learn from record j.
void Cache::guard(size_t i, size_t j) {
  Extent& extent = extents_[i];
  const Vec2d offset = records_[j].position - records_[i].position;
  if (settings_.guards.neighbour_clamp)
    extent.bound = std::min(extent.bound, extents_[j].base.longest() + glm::length(offset));
  if (!settings_.guards.verify) return;
  const double square = extent.base.normalised_square(offset);
  if (!(square < 1)) return;
  if (settings_.guards.depth && !records_[i].surroundings.depth.reaches(offset)) return;
  const double found = records_[j].mean.value;
  const double error = std::fabs(extrapolated(settings_, records_[i], offset) - found);
  const double tolerance =
      verify_tolerance(settings_, extent.base) * std::max({records_[i].mean.value, found, radiance_floor_});
  if (error > tolerance)
    extent.scale = std::min(extent.scale, std::sqrt(square) * std::max(std::sqrt(tolerance / error), 0.5));
}

void Cache::apply(Extent& extent) const {
  extent.guarded = extent.base.clamped(extent.scale, extent.bound, settings_.minimum_radius);
}

std::optional<double> Cache::look_up(const Vec2d& point) const {
  double weights = 0;
  double sum = 0;
  for (size_t i = 0; i < records_.size(); ++i) {
    const Vec2d offset = point - records_[i].position;
    const double square = extents_[i].guarded.normalised_square(offset);
    if (!(square < 1)) continue;
    if (settings_.guards.depth && !records_[i].surroundings.depth.reaches(offset)) continue;
    const double d = 1 - std::sqrt(square);
    const double weight = d * d * (3 - 2 * d);
    weights += weight;
    sum += weight * extrapolated(settings_, records_[i], offset);
  }
  if (!(weights > 0)) return std::nullopt;
  return sum / weights;
}

}  // namespace fogbank::cache::flatland
