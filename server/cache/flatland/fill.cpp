#include "cache/flatland/fill.h"

#include <algorithm>
#include <string>
#include <utility>

#include "core/error.h"

namespace fogbank::cache::flatland {

namespace {

/// Of gaps in the ring that margins and depths are read off (ratio-records.md section 2, item 3).
constexpr int guard_bisections = 6;

constexpr double floor_share = 0.05;

struct MadeRecord {
  Record record;
  uint64_t rays = 0;
};

MadeRecord made(const derivatives::flatland::Model& model, const Vec2d& x) {
  namespace flatland = derivatives::flatland;
  const flatland::Settings& settings = model.settings();
  const flatland::Estimate estimate = model.estimate(x);
  MadeRecord result;
  Record& record = result.record;
  record.position = x;
  record.mean = estimate.mean;
  const bool bisected = settings.method == flatland::Method::aware && settings.bisections > 0;
  record.mean.value = std::max(0.0, bisected ? estimate.mean.value : estimate.stratified_mean);
  if (estimate.gradient_magnitude > 0) record.change_length = record.mean.value / estimate.gradient_magnitude;
  const flatland::Ring ring =
      flatland::make_ring(model.scene(), x, settings.samples, guard_bisections, settings.seed);
  record.surroundings = {DepthBins(ring), visibility_margin(model.scene(), ring, x)};
  result.rays = estimate.rays + ring.rays;
  return result;
}

}  // namespace

Record make_record(const derivatives::flatland::Model& model, const Vec2d& x) {
  return made(model, x).record;
}

Fill::Fill(std::shared_ptr<const derivatives::flatland::Model> model, const Settings& settings,
           std::vector<Vec2d> points, size_t pilot)
    : model_(std::move(model)), settings_(settings), points_(std::move(points)), pilot_(pilot) {
  validate(settings_);
  if (pilot_ < 1 || pilot_ > points_.size()) {
    throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS", "pilot: must be 1 to the number of points");
  }
  radiance_.reserve(points_.size());
}

bool Fill::advance(size_t points) {
  for (size_t i = 0; i < points && stage_ != Stage::done; ++i) step();
  return stage_ != Stage::done;
}

void Fill::step() {
  const Vec2d& x = points_[next_++];
  switch (stage_) {
    case Stage::pilot: {
      const MadeRecord record = made(*model_, x);
      rays_ += record.rays;
      pilot_records_.push_back(record.record);
      if (next_ == pilot_) end_pilot();
      break;
    }
    case Stage::fill:
      if (!cache_->look_up(x)) add(x);
      if (next_ == points_.size()) {
        if (cache_->size() == size_before_) stage_ = Stage::look_up;
        size_before_ = cache_->size();
        next_ = 0;
      }
      break;
    case Stage::look_up:
      radiance_.push_back(cache_->look_up(x).value());
      if (next_ == points_.size()) stage_ = Stage::done;
      break;
    case Stage::done:
      break;
  }
}

void Fill::end_pilot() {
  double sum = 0;
  for (const Record& record : pilot_records_) sum += record.mean.value;
  // In the dark any floor is right.
  const double floor = sum > 0 ? floor_share * sum / static_cast<double>(pilot_) : 1;
  cache_.emplace(settings_, floor);
  for (const Record& record : pilot_records_) cache_->add(record);
  pilot_records_.clear();
  size_before_ = cache_->size();
  next_ = 0;
  stage_ = Stage::fill;
}

void Fill::add(const Vec2d& x) {
  if (static_cast<int64_t>(cache_->size()) >= largest_record_count) {
    throw Error(ErrorKind::resource_exhausted, "TOO_MANY_RECORDS",
                "the points need more than " + std::to_string(largest_record_count) +
                    " records; a greater threshold or minimum_radius, please");
  }
  const MadeRecord record = made(*model_, x);
  rays_ += record.rays;
  cache_->add(record.record);
}

}  // namespace fogbank::cache::flatland
