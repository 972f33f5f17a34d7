#include "cache/record_makers/unaware.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/sampling.h"
#include "scene/scene.h"

namespace fogbank::cache {

namespace {

/// Independent estimates: their difference tells the variance.
constexpr uint32_t repeats = 2;
/// Edges of paths that light takes straight from an emitter to a place that a camera sees.
constexpr int32_t direct_depth = 2;
/// Stands for a length without end: nothing changes. Record::proxy is finite.
constexpr double greatest_length = 1e30;
/// Rays of the depth guard are this many squared, four to a bin.
constexpr uint32_t depth_side = 2 * DepthBins::resolution;

derivatives::EstimatorSettings estimator_settings(Quantity quantity, const RecordMakerSettings& settings) {
  derivatives::EstimatorSettings result;
  result.derivatives = derivatives::DerivativeOrder::gradient;
  result.emission = quantity == Quantity::unaware_direct;
  result.samples = settings.samples;
  result.repeats = repeats;
  result.max_depth = result.emission ? direct_depth : settings.max_depth;
  result.seed = settings.seed;
  return result;
}

}  // namespace

UnawareRecordMaker::UnawareRecordMaker(Quantity quantity, std::shared_ptr<const transport::World> world,
                                       const RecordMakerSettings& settings)
    : world_(std::move(world)),
      settings_(estimator_settings(quantity, settings)),
      estimator_(world_, settings_) {
  derivatives::validate(settings_);
}

uint64_t UnawareRecordMaker::id_of(const Wish& wish) const {
  return content_id(
      wish.position, wish.component,
      "unaware " + std::to_string(settings_.samples) + ' ' + std::to_string(settings_.max_depth),
      settings_.seed);
}

Record UnawareRecordMaker::make(const Wish& wish, RayCounters& counters) const {
  const uint64_t rays_before = counters.total();
  std::array<double, repeats> luminances{};
  derivatives::RadianceJet mean;
  double gradient_magnitude = 0;
  for (uint32_t repeat = 0; repeat < repeats; ++repeat) {
    const derivatives::UnawareEstimate estimate =
        estimator_.estimate_changes(wish.position, repeat, counters);
    luminances[repeat] = estimate.mean.luminance().value;
    mean += estimate.mean;
    gradient_magnitude += estimate.gradient_magnitude / repeats;
  }
  mean *= 1.0 / repeats;
  Record record;
  record.position = wish.position;
  record.component = wish.component;
  for (int c = 0; c < 3; ++c) {
    const derivatives::Jet3d& channel = mean.channels[static_cast<size_t>(c)];
    record.radiance[c] = std::fmax(static_cast<float>(channel.value), 0.0f);
    record.gradient[static_cast<size_t>(c)] = Vec3f(channel.gradient);
  }
  const double level = static_cast<double>(luminance(record.radiance));
  record.proxy = static_cast<float>(gradient_magnitude > level / greatest_length ? level / gradient_magnitude
                                                                                 : greatest_length);
  record.samples = static_cast<uint32_t>(std::max<uint64_t>(counters.total() - rays_before, 1));
  const double half_difference = (luminances[0] - luminances[1]) / 2;
  record.variance = static_cast<float>(half_difference * half_difference);
  record.depth = look_around(wish.position, counters);
  record.id = id_of(wish);
  return record;
}

DepthBins UnawareRecordMaker::look_around(const Vec3f& position, RayCounters& counters) const {
  const scene::Intersector& intersector = *world_->scene().intersector;
  DepthBins bins;
  for (uint32_t i = 0; i < depth_side * depth_side; ++i) {
    const uint32_t row = i / depth_side;
    const Vec2f cell(static_cast<float>(i % depth_side), static_cast<float>(row));
    const Vec3f direction = square_to_uniform_sphere((cell + 0.5f) / static_cast<float>(depth_side));
    scene::Hit hit;
    ++counters.closest_hit;
    if (intersector.intersect_solid({position, direction, infinity}, hit))
      bins.insert(direction, hit.distance);
  }
  return bins;
}

}  // namespace fogbank::cache
