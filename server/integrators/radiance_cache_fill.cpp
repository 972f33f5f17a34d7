#include "integrators/radiance_cache_fill.h"

#include <algorithm>
#include <utility>

#include "cache/metric.h"
#include "integrators/uncovered_places.h"
#include "scene/intersector.h"

namespace fogbank::integrators {

namespace {

constexpr int32_t first_stride = 16;
constexpr int32_t last_stride = 2;
constexpr int32_t last_preview_stride = 8;
/// Rounds of making records for one stride; what is uncovered then is left to the next finer one.
constexpr int32_t most_attempts = 6;
/// Rows of pixels that a probing task looks at, in strides.
constexpr int32_t band_strides = 4;
/// Stream of random numbers apart from the image's own.
constexpr uint32_t probe_stream = 1;
/// Directions of a place's first record.
constexpr int32_t first_samples = 64;
/// Rays of a path-traced record, for each of these, above which photons are worth being traced first: paths
/// in dense media of high albedo.
constexpr double long_paths_rays = 180;
/// Generation 0 holds paths of max_depth edges at most, photons end paths with up to as many more. Where that
/// may be more than a trace records are path traced.
constexpr int32_t least_depth_of_photons = 8;
/// Further records of a place: the noisier the picture would be, the more.
constexpr uint32_t most_level = 6;
/// Rounds of further records in a stage.
constexpr int32_t most_refinements = 3;
/// Pixels between rays that are looked at for noise: at most so many, and less in films that would have fewer
/// than `least_surveyed_side` of them a side, where a record may be a few pixels wide.
constexpr int32_t greatest_surveying_stride = 8;
constexpr int32_t least_surveyed_side = 32;
/// Share of a stage's error that the noise of records may have.
constexpr double noise_share = 0.3;
/// Of ratios: grids of 8 x 8 cells over a light.
constexpr int32_t ratio_samples = 1024;
/// Relative error at the border of typical extents, for a relative error of pixels of 1: errors there are the
/// largest of an extent, and those of a ray's records partly cancel.
constexpr double border_error_per_error = 3;
constexpr double greatest_radius = 0.25;  ///< of the scene's (method.md section 17)
constexpr double least_radius = 1e-4;     ///< of the scene's

/// Of photons, for the relative error that is wanted of pixels. Their noise is common to all records, so it
/// falls as that error's square root only: gathers over all directions make it small.
uint32_t photon_paths(double error) {
  constexpr double at_once = 1 << 16;
  constexpr double most_times = 16;
  return static_cast<uint32_t>(at_once * std::clamp(0.5 / error, 1.0, most_times));
}

}  // namespace

RadianceCacheFill::RadianceCacheFill(RadianceCacheIntegrator& integrator, const CameraRays& camera,
                                     const CacheTarget& target)
    : integrator_(integrator),
      camera_(camera),
      target_(target),
      before_(integrator.published()),
      stride_(first_stride) {}

RadianceCacheFill::~RadianceCacheFill() {
  if (round_ == Round::begin || round_ == Round::done) return;
  try {
    leave_unfinished();
  } catch (const std::exception&) {
    // What was not kept is made again.
  }
}

void RadianceCacheFill::leave_unfinished() {
  std::erase_if(made_, [](const cache::Record& record) { return record.id == 0; });
  if (before_.epoch) {
    // Its extents covered the picture; those that were aimed at don't yet.
    const uint64_t made = add_made();
    before_.epoch =
        std::make_shared<const cache::Epoch>(integrator_.cache().records(), before_.epoch->settings());
    integrator_.publish(before_, made);
    return;
  }
  publish();
}

void RadianceCacheFill::choose_generation() {
  // Photons end paths in media of isotropic phase functions only.
  std::vector<cache::Record> pilot = integrator_.pilot().records();
  std::erase_if(
      pilot, [](const cache::Record& record) { return record.component.quantity != cache::Quantity::rest; });
  double rays = 0;
  for (const cache::Record& record : pilot) rays += static_cast<double>(record.samples);
  const bool long_paths = rays > long_paths_rays * first_samples * static_cast<double>(pilot.size());
  const int32_t max_depth = integrator_.settings().max_depth;
  const bool any_depth = max_depth < 0 || max_depth >= least_depth_of_photons;
  generation_ = long_paths && any_depth ? 1 : 0;
}

void RadianceCacheFill::need_maker(const cache::Component& component, uint32_t level) {
  const bool photons = component.scattering_order > 0;
  std::unique_ptr<const cache::RecordMaker>& maker = makers_[{component.quantity, photons, level}];
  if (maker) return;
  cache::RecordMakerSettings settings{.samples = first_samples << (2 * level),
                                      .max_depth = integrator_.settings().max_depth};
  if (component.quantity == cache::Quantity::ratio) settings = {.samples = ratio_samples};
  if (photons) settings.photons = integrator_.photons(photon_paths(target_.error));
  maker = cache::make_record_maker(component.quantity, integrator_.world(), settings);
}

const cache::RecordMaker& RadianceCacheFill::maker(const cache::Component& component, uint32_t level) const {
  return *makers_.at({component.quantity, component.scattering_order > 0, level});
}

double RadianceCacheFill::fraction() const {
  return round_ == Round::done ? 1 : 1 - static_cast<double>(stride_) / first_stride;
}

void RadianceCacheFill::settle() {
  if (std::exchange(settled_, true)) return;
  if (round_ == Round::probing) grant_wishes();
  if (round_ == Round::surveying) grant_refinements();
}

uint32_t RadianceCacheFill::next_round() {
  settle();
  settled_ = false;
  switch (round_) {
    case Round::begin:
      if (CachePilot& pilot = integrator_.pilot(); pilot.records().empty()) {
        pilot.recall(*integrator_.cache().records());
        // Who only reads looks at how bright the scene is all the same.
        const bool reads_only = integrator_.settings().most_records == 0;
        const auto count = static_cast<uint32_t>(
            reads_only ? pilot.count() : std::min<uint64_t>(pilot.count(), records_left()));
        if (count > 0) {
          for (uint32_t place = 0; place < count; ++place) need_maker(pilot.component(place), 0);
          round_ = Round::pilot;
          return count;
        }
      }
      choose_generation();
      publish();
      return begin_bands(Round::probing);
    case Round::pilot:
      if (integrator_.settings().most_records > 0) made_ = integrator_.pilot().records();
      choose_generation();
      publish();
      return begin_bands(Round::probing);
    case Round::probing:
      if (!granted_.empty() && ++attempts_ <= most_attempts) {
        levels_.assign(granted_.size(), 0);
        return begin_making(Round::making);
      }
      attempts_ = 0;
      if (stride_ <= (target_.preview ? last_preview_stride : last_stride)) return begin_surveying();
      stride_ /= 2;
      return begin_bands(Round::probing);
    case Round::making:
      publish();
      return begin_bands(Round::probing);
    case Round::surveying:
      if (!granted_.empty()) return begin_making(Round::refining);
      round_ = Round::done;
      break;
    case Round::refining:
      publish();
      return begin_surveying();
    case Round::done:
      break;
  }
  return 0;
}

uint32_t RadianceCacheFill::begin_making(Round round) {
  round_ = round;
  made_.assign(granted_.size(), {});
  for (size_t i = 0; i < granted_.size(); ++i) need_maker(granted_[i].component, levels_[i]);
  return static_cast<uint32_t>(granted_.size());
}

uint32_t RadianceCacheFill::begin_bands(Round round) {
  round_ = round;
  const scene::Window window = camera_.window();
  const int32_t rows = band_strides * stride_;
  const int32_t end = (window.y + window.height + rows - 1) / rows;
  const auto bands = static_cast<uint32_t>(end - window.y / rows);
  if (round == Round::probing) found_.assign(bands, {});
  if (round == Round::surveying) noise_.assign(bands, RecordNoise(*integrator_.published().epoch));
  return bands;
}

uint32_t RadianceCacheFill::begin_surveying() {
  const Vec2i film = camera_.film_size();
  stride_ = std::clamp(std::min(film.x, film.y) / least_surveyed_side, 1, greatest_surveying_stride);
  if (refinements_++ < most_refinements && records_left() > 0) return begin_bands(Round::surveying);
  round_ = Round::done;
  return 0;
}

void RadianceCacheFill::grant_refinements() {
  RecordNoise noise(*integrator_.published().epoch);
  for (RecordNoise& band : noise_) noise.append(std::move(band));
  granted_.clear();
  levels_.clear();
  const cache::RecordSet& set = integrator_.published().epoch->records();
  for (const auto& [index, place] : noise.noisy(noise_share * target_.error)) {
    const cache::ComponentRange& range = index->range();
    // Levels come one after the other, so that their number tells the next.
    const uint32_t level = range.end(place) - range.begin(place);
    // Ratios are closed forms but for what is visible, which more of the same grid would not tell.
    if (range.component.quantity == cache::Quantity::ratio) continue;
    if (level > most_level || granted_.size() >= records_left()) continue;
    granted_.push_back({set.position(range, place), set.normal(range, place), range.component});
    levels_.push_back(level);
  }
}

void RadianceCacheFill::run(uint32_t task, RayCounters& counters) {
  scene::prepare_render_thread();
  switch (round_) {
    case Round::pilot:
      integrator_.pilot().make(task, maker(integrator_.pilot().component(task)), counters);
      break;
    case Round::probing: {
      UncoveredPlaces uncovered(integrator_.published().typical_radius);
      observe_band(
          task, uncovered, [] {}, counters);
      found_[task] = std::move(uncovered).places();
      break;
    }
    case Round::surveying:
      observe_band(
          task, noise_[task], [&] { noise_[task].end_ray(); }, counters);
      break;
    case Round::making:
    case Round::refining:
      made_[task] = make_granted(task, counters);
      break;
    case Round::begin:
    case Round::done:
      break;
  }
}

cache::Record RadianceCacheFill::make_granted(uint32_t number, RayCounters& counters) const {
  const cache::Wish& wish = granted_[number];
  const cache::RecordMaker& its_maker = maker(wish.component, levels_[number]);
  if (std::optional<cache::Record> known = integrator_.cache().spare(its_maker.id_of(wish))) return *known;
  return its_maker.make(wish, counters);
}

template <typename EndRay>
void RadianceCacheFill::observe_band(uint32_t band, LookUpObserver& observer, const EndRay& end_ray,
                                     RayCounters& counters) const {
  // Pixels of the film, whatever the window: a part of a picture looks where the whole one looked.
  const scene::Window window = camera_.window();
  const auto at_least = [this](int32_t bound) {
    const int32_t half = stride_ / 2;
    return half + std::max(bound - half + stride_ - 1, 0) / stride_ * stride_;
  };
  const int32_t rows = band_strides * stride_;
  const int32_t first = (window.y / rows + static_cast<int32_t>(band)) * rows;
  const int32_t last = std::min(first + rows, window.y + window.height);
  for (int32_t y = at_least(std::max(first, window.y)); y < last; y += stride_) {
    counters.poll();
    for (int32_t x = at_least(window.x); x < window.x + window.width; x += stride_) {
      const auto film_x = static_cast<uint32_t>(x);
      const auto film_y = static_cast<uint32_t>(y);
      RandomStream random(0, film_x, film_y, 0, probe_stream);
      const Ray ray = camera_.sample(film_x, film_y, random);
      integrator_.observe(ray, random, counters, observer);
      end_ray();
    }
  }
}

void RadianceCacheFill::grant_wishes() {
  std::vector<cache::SpacedWish> all;
  for (std::vector<cache::SpacedWish>& band : found_) std::ranges::move(band, std::back_inserter(all));
  granted_.clear();
  for (const uint32_t i : cache::thin(all, 0, records_left())) granted_.push_back(all[i].wish);
}

uint64_t RadianceCacheFill::records_left() const {
  const auto most = static_cast<uint64_t>(integrator_.settings().most_records);
  return most - std::min(most, integrator_.cache_counts().records_new);
}

uint64_t RadianceCacheFill::add_made() {
  // The pilot's records may be there already.
  const size_t before = integrator_.cache().records()->size();
  integrator_.cache().add(std::exchange(made_, {}));
  return integrator_.cache().records()->size() - before;
}

void RadianceCacheFill::publish() {
  const uint64_t made = add_made();
  const std::shared_ptr<const cache::RecordSet> records = integrator_.cache().records();
  const PilotedMetric piloted = pilot_metric(target_.error);
  cache::MetricSettings metric = metric_of(piloted);
  metric.footprints = {{camera_.position(), camera_.pixel_angle()}};
  integrator_.publish({std::make_shared<const cache::Epoch>(records, metric), target_.error, generation_,
                       piloted.typical_radius, generation_ > 0 ? photon_paths(target_.error) : 0},
                      made);
}

void RadianceCacheFill::publish_as_it_is(uint8_t generation) {
  generation_ = generation;
  publish();
}

PilotedMetric RadianceCacheFill::pilot_metric(double error) const {
  return integrator_.pilot().metric(border_error_per_error * error, greatest_radius * scene_radius());
}

double RadianceCacheFill::scene_radius() const {
  const auto radius = static_cast<double>(integrator_.world()->scene().bounds.radius);
  return radius > 0 ? radius : 1 / greatest_radius;
}

cache::MetricSettings RadianceCacheFill::metric_of(const PilotedMetric& piloted) const {
  cache::MetricSettings metric;
  metric.maximum_radius = greatest_radius * scene_radius();
  metric.threshold = piloted.threshold;
  metric.first_order_change = piloted.first_order_change;
  metric.radiance_floor = piloted.radiance_floor;
  metric.direct_floor = direct_floor_;
  metric.minimum_radius = std::max(least_radius * scene_radius(), integrator_.settings().minimum_radius);
  metric.shape = integrator_.settings().spheres ? cache::Shape::sphere : cache::Shape::ellipsoid;
  return metric;
}

}  // namespace fogbank::integrators
