#include "integrators/radiance_cache_fill.h"

#include <algorithm>
#include <utility>

#include "cache/metric.h"
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
/// Directions of records that trace paths: they are looked up by thousands of gathers, which averages noise.
constexpr int32_t traced_samples = 64;
/// Of records that read others.
constexpr int32_t gathered_samples = 256;
/// Places that are looked for per record, to see where sources are missing.
constexpr int32_t source_probes = 32;
/// Error that sources are made for: gathers average theirs over all directions.
constexpr double source_error = 0.3;
/// Below this path length what a record reads would have to know how long its paths may be.
constexpr int32_t least_depth_of_generations = 6;
/// Spacing of a round's records, in radii that they are thought to have: spheres of that radius cover what
/// lies within the spacing with a weight of 0.05 at least.
constexpr float spacing_share = 0.85f;
/// A look-up of less weight counts as uncovered: right at the border of an extent the next pixel may be out.
constexpr float least_weight = 0.02f;
/// As many records reach a place but for a surface between, as far as their depth bins tell: one more would
/// not see it either. Close to walls bins are too coarse; paths take the records' place there.
constexpr uint32_t most_hidden = 3;
/// Look-ups whose radiance counts less than this in the pixel aren't worth a record.
constexpr float least_importance = 1e-4f;
/// Relative error at the border of typical extents, for a relative error of pixels of 1: errors there are the
/// largest of an extent, and those of a ray's records partly cancel.
constexpr double border_error_per_error = 3;
constexpr double greatest_radius = 0.25;  ///< of the scene's (method.md section 17)
constexpr double least_radius = 1e-4;     ///< of the scene's

/// Distance that records keep from a surface ahead, in radii: on it half of the light would be missed, and
/// derivatives grow with the nearness of what they see.
constexpr float clearance_share = 0.2f;

/// Collects the look-ups of a few camera rays that want a record.
class UncoveredPlaces final : public LookUpObserver {
 public:
  explicit UncoveredPlaces(float default_reach) : default_reach_(default_reach) {}

  void look_up(const LookUp& look_up) override {
    const bool on_surface = look_up.place.normal != Vec3f(0);
    if (look_up.found.weight >= least_weight) {
      if (on_surface) covered_.push_back({look_up.place, look_up.found.radius});
      return;
    }
    if (!(mean(look_up.weight) > least_importance)) return;
    if (look_up.found.rejected >= most_hidden) return;
    if (on_surface) {
      on_surfaces_.push_back(look_up.place);
      return;
    }
    const float reach = std::isfinite(look_up.reach) ? look_up.reach : default_reach_;
    cache::Wish place = look_up.place;
    const float retreat = std::fmax(clearance_share * reach - look_up.ahead, 0.0f);
    place.position -= look_up.direction * std::fmin(retreat, 0.5f * look_up.behind);
    places_.push_back({place, spacing_share * reach});
  }

  /// Surface records go by the reach of those that neighbouring rays met.
  std::vector<cache::SpacedWish> places() && {
    for (const cache::Wish& wish : on_surfaces_) {
      float reach = infinity;
      for (const auto& [place, radius] : covered_)
        if (place.component == wish.component && glm::dot(place.normal, wish.normal) > cache::similar_normals)
          reach = std::fmin(reach, radius + glm::distance(place.position, wish.position));
      places_.push_back({wish, spacing_share * (std::isfinite(reach) ? reach : default_reach_)});
    }
    return std::move(places_);
  }

 private:
  float default_reach_;
  std::vector<cache::SpacedWish> places_;
  std::vector<cache::Wish> on_surfaces_;
  std::vector<std::pair<cache::Wish, float>> covered_;  ///< on surfaces, with radii
};

}  // namespace

RadianceCacheFill::RadianceCacheFill(RadianceCacheIntegrator& integrator, const CameraRays& camera,
                                     const CacheTarget& target)
    : integrator_(integrator), camera_(camera), target_(target), stride_(first_stride) {
  const CacheTechnique& technique = integrator.technique();
  std::vector<cache::Quantity> quantities{technique.rest, cache::Quantity::irradiance};
  if (technique.direct) quantities.push_back(*technique.direct);
  const int32_t max_depth = integrator.settings().max_depth;
  for (const cache::Quantity quantity : quantities)
    for (const bool reads : {false, true})
      makers_[{quantity, reads}] = cache::make_record_maker(
          quantity, integrator.world(),
          {.samples = reads ? gathered_samples : traced_samples, .max_depth = max_depth});
  const bool few_events = max_depth >= 0 && max_depth < least_depth_of_generations;
  const bool read_others = technique.rest == cache::Quantity::rest;
  generation_ = target.preview || few_events || !read_others ? 0 : 1;
}

const cache::RecordMaker& RadianceCacheFill::maker(const cache::Component& component) const {
  return *makers_.at({component.quantity, component.scattering_order > 0});
}

double RadianceCacheFill::fraction() const {
  return round_ == Round::done ? 1 : 1 - static_cast<double>(stride_) / first_stride;
}

uint32_t RadianceCacheFill::next_round() {
  switch (round_) {
    case Round::begin:
      if (CachePilot& pilot = integrator_.pilot(); pilot.records().empty()) {
        // Who only reads looks at how bright the scene is all the same.
        const bool reads_only = integrator_.settings().most_records == 0;
        const auto count = static_cast<uint32_t>(
            reads_only ? pilot.count() : std::min<uint64_t>(pilot.count(), records_left()));
        if (count > 0) {
          round_ = Round::pilot;
          return count;
        }
      }
      publish();
      return begin_probing();
    case Round::pilot:
      if (integrator_.settings().most_records > 0) made_ = integrator_.pilot().records();
      publish();
      return begin_probing();
    case Round::probing:
      grant_wishes();
      if (!granted_.empty() && ++attempts_ <= most_attempts) {
        if (generation_ == 0) return begin_making(Round::making, granted_);
        round_ = Round::finding_sources;
        found_.assign(granted_.size(), {});
        return static_cast<uint32_t>(granted_.size());
      }
      attempts_ = 0;
      if (stride_ <= (target_.preview ? last_preview_stride : last_stride)) {
        round_ = Round::done;
        return 0;
      }
      stride_ /= 2;
      return begin_probing();
    case Round::finding_sources:
      grant_sources();
      if (!granted_sources_.empty()) return begin_making(Round::making_sources, granted_sources_);
      return begin_making(Round::making, granted_);
    case Round::making_sources:
      publish();
      return begin_making(Round::making, granted_);
    case Round::making:
      publish();
      return begin_probing();
    case Round::done:
      break;
  }
  return 0;
}

uint32_t RadianceCacheFill::begin_making(Round round, const std::vector<cache::Wish>& wishes) {
  round_ = round;
  made_.assign(wishes.size(), {});
  return static_cast<uint32_t>(wishes.size());
}

uint32_t RadianceCacheFill::begin_probing() {
  round_ = Round::probing;
  const scene::Window window = camera_.window();
  const int32_t rows = band_strides * stride_;
  found_.assign(static_cast<size_t>((window.height + rows - 1) / rows), {});
  return static_cast<uint32_t>(found_.size());
}

void RadianceCacheFill::run(uint32_t task, RayCounters& counters) {
  scene::prepare_render_thread();
  switch (round_) {
    case Round::pilot:
      integrator_.pilot().make(task, maker({.quantity = integrator_.technique().rest}), counters);
      break;
    case Round::probing:
      probe(task, counters);
      break;
    case Round::finding_sources:
      find_sources(task, counters);
      break;
    case Round::making_sources:
      made_[task] = maker(granted_sources_[task].component).make(granted_sources_[task], nullptr, counters);
      break;
    case Round::making:
      made_[task] = maker(granted_[task].component).make(granted_[task], sources_.get(), counters);
      break;
    case Round::begin:
    case Round::done:
      break;
  }
}

void RadianceCacheFill::probe(uint32_t band, RayCounters& counters) {
  const scene::Window window = camera_.window();
  UncoveredPlaces uncovered(integrator_.published().typical_radius);
  const int32_t first = static_cast<int32_t>(band) * band_strides * stride_;
  const int32_t last = std::min(first + band_strides * stride_, window.height);
  for (int32_t y = first + stride_ / 2; y < last; y += stride_) {
    counters.poll();
    for (int32_t x = stride_ / 2; x < window.width; x += stride_) {
      const auto film_x = static_cast<uint32_t>(window.x + x);
      const auto film_y = static_cast<uint32_t>(window.y + y);
      RandomStream random(0, film_x, film_y, 0, probe_stream);
      const Ray ray = camera_.sample(film_x, film_y, random);
      integrator_.observe(ray, random, counters, uncovered);
    }
  }
  found_[band] = std::move(uncovered).places();
}

void RadianceCacheFill::grant_wishes() {
  std::vector<cache::SpacedWish> all;
  for (std::vector<cache::SpacedWish>& band : found_) std::ranges::move(band, std::back_inserter(all));
  granted_.clear();
  for (const uint32_t i : cache::thin(all, 0, records_left())) granted_.push_back(all[i].wish);
}

void RadianceCacheFill::find_sources(uint32_t number, RayCounters& counters) {
  const cache::Wish& wish = granted_[number];
  std::vector<cache::SpacedWish> missing;
  for (const cache::Wish& source : maker(wish.component).sources_of(wish, source_probes, counters)) {
    const cache::Index* index = sources_->find(source.component);
    const bool on_surface = source.component.quantity == cache::Quantity::irradiance;
    const float weight = index == nullptr ? 0
                         : on_surface     ? index->look_up(source.position, source.normal).weight
                                          : index->look_up(source.position).weight;
    if (weight < least_weight) missing.push_back({source, spacing_share * sources_radius_});
  }
  found_[number] = std::move(missing);
}

void RadianceCacheFill::grant_sources() {
  std::vector<cache::SpacedWish> all;
  for (std::vector<cache::SpacedWish>& found : found_) std::ranges::move(found, std::back_inserter(all));
  granted_sources_.clear();
  const uint64_t left = records_left();
  const uint64_t most = left - std::min<uint64_t>(left, granted_.size());
  for (const uint32_t i : cache::thin(all, 0, most)) granted_sources_.push_back(all[i].wish);
}

uint64_t RadianceCacheFill::records_left() const {
  const auto most = static_cast<uint64_t>(integrator_.settings().most_records);
  return most - std::min(most, integrator_.cache_counts().records_new);
}

void RadianceCacheFill::publish() {
  // The pilot's records may be there already.
  const size_t before = integrator_.cache().records()->size();
  integrator_.cache().add(std::exchange(made_, {}));
  const std::shared_ptr<const cache::RecordSet> records = integrator_.cache().records();
  const uint64_t made = records->size() - before;
  const PilotedMetric piloted = pilot_metric(target_.error);
  cache::MetricSettings metric = metric_of(piloted);
  metric.footprints = {{camera_.position(), camera_.pixel_angle()}};
  integrator_.publish(
      {std::make_shared<const cache::Epoch>(records, metric), generation_, piloted.typical_radius}, made);
  if (generation_ == 0) return;
  const PilotedMetric of_sources = pilot_metric(source_error);
  sources_ = std::make_shared<const cache::Epoch>(records, metric_of(of_sources));
  sources_radius_ = of_sources.typical_radius;
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
  metric.minimum_radius = least_radius * scene_radius();
  metric.shape = integrator_.settings().spheres ? cache::Shape::sphere : cache::Shape::ellipsoid;
  return metric;
}

}  // namespace fogbank::integrators
