#include "integrators/radiance_cache_fill.h"

#include <algorithm>

namespace fogbank::integrators {

namespace {

constexpr int32_t first_stride = 16;
constexpr int32_t last_stride = 2;
/// Rounds of making records for one stride; what is uncovered then is left to the next finer one.
constexpr int32_t most_attempts = 4;
/// Rows of pixels that a probing task looks at, in strides.
constexpr int32_t band_strides = 4;
/// Stream of random numbers apart from the image's own.
constexpr uint32_t probe_stream = 1;
constexpr int32_t record_samples = 256;
/// Spacing of the first records, in radii of the scene.
constexpr float first_spacing = 0.15f;
/// Border error of a ball of a tenth of the scene's radius is 15 eps / (4 pi R^3) = error.
constexpr double threshold_per_error = 4 * 3.14159265358979 / 15 * 1e-3;

}  // namespace

RadianceCacheFill::RadianceCacheFill(RadianceCacheIntegrator& integrator, const CameraRays& camera,
                                     const CacheTarget& target)
    : integrator_(integrator), camera_(camera), target_(target), stride_(first_stride) {
  const IntegratorSettings& settings = integrator.settings();
  maker_ = cache::make_record_maker(cache::Quantity::rest, integrator.world(),
                                    {.samples = record_samples, .max_depth = settings.max_depth});
  publish();
}

double RadianceCacheFill::fraction() const { return 1 - static_cast<double>(stride_) / first_stride; }

uint32_t RadianceCacheFill::next_round() {
  switch (round_) {
    case Round::none:
      break;
    case Round::probing:
      grant_wishes();
      if (!granted_.empty()) {
        round_ = Round::computing;
        computed_.resize(granted_.size());
        return static_cast<uint32_t>(granted_.size());
      }
      if (!finer()) return 0;
      break;
    case Round::computing:
      publish();
      if (++attempts_ >= most_attempts && !finer()) return 0;
      break;
  }
  round_ = Round::probing;
  const scene::Window window = camera_.window();
  const int32_t rows = band_strides * stride_;
  found_.assign(static_cast<size_t>((window.height + rows - 1) / rows), {});
  return static_cast<uint32_t>(found_.size());
}

bool RadianceCacheFill::finer() {
  attempts_ = 0;
  stride_ /= 2;
  return stride_ >= last_stride;
}

void RadianceCacheFill::run(uint32_t task, RayCounters& counters) {
  if (round_ == Round::probing) {
    probe(task, counters);
  } else {
    computed_[task] = maker_->make(granted_[task], nullptr, counters);
  }
}

void RadianceCacheFill::probe(uint32_t band, RayCounters& counters) {
  const scene::Window window = camera_.window();
  std::vector<cache::Wish> found;
  const int32_t first = static_cast<int32_t>(band) * band_strides * stride_;
  const int32_t last = std::min(first + band_strides * stride_, window.height);
  for (int32_t y = first + stride_ / 2; y < last; y += stride_) {
    for (int32_t x = stride_ / 2; x < window.width; x += stride_) {
      const auto film_x = static_cast<uint32_t>(window.x + x);
      const auto film_y = static_cast<uint32_t>(window.y + y);
      RandomStream random(0, film_x, film_y, static_cast<uint32_t>(stride_ * most_attempts + attempts_),
                          probe_stream);
      const Ray ray = camera_.sample(film_x, film_y, random);
      integrator_.walk_from(ray, random, counters, &found);
    }
  }
  found_[band] = std::move(found);
}

void RadianceCacheFill::grant_wishes() {
  std::vector<cache::Wish> all;
  for (std::vector<cache::Wish>& band : found_) std::ranges::move(band, std::back_inserter(all));
  const float spacing = first_spacing * integrator_.world()->scene().bounds.radius;
  const auto most = static_cast<size_t>(integrator_.settings().most_records) -
                    static_cast<size_t>(integrator_.cache_counts().records_new);
  granted_.clear();
  for (const uint32_t i : cache::thin(all, places_, spacing, 0, most)) granted_.push_back(all[i]);
}

void RadianceCacheFill::publish() {
  const uint64_t made = computed_.size();
  integrator_.cache().add(std::exchange(computed_, {}));
  const auto records = integrator_.cache().records();
  places_.clear();
  double mean = 0;
  for (size_t i = 0; i < records->size(); ++i) {
    const cache::Record record = records->record(i);
    places_.push_back({record.position, record.normal, record.component});
    mean += static_cast<double>(luminance(record.radiance));
  }
  mean /= static_cast<double>(std::max<size_t>(records->size(), 1));
  const auto radius = static_cast<double>(integrator_.world()->scene().bounds.radius);
  cache::MetricSettings metric;
  metric.threshold = threshold_per_error * target_.error * radius * radius * radius;
  metric.radiance_floor = std::fmax(0.05 * mean, 1e-30);
  metric.maximum_radius = 0.25 * radius;
  metric.minimum_radius = 0.005 * radius;
  integrator_.publish(std::make_shared<const cache::Epoch>(records, metric), made);
}

}  // namespace fogbank::integrators
