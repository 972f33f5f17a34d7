#include "cache/record_makers/rest.h"

#include <algorithm>
#include <cmath>

#include "core/sampling.h"
#include "scene/scene.h"

namespace fogbank::cache {

RestRecordMaker::RestRecordMaker(std::shared_ptr<const transport::World> world,
                                 const RecordMakerSettings& settings)
    : world_(std::move(world)) {
  settings_.emission = false;
  settings_.samples = settings.samples;
  settings_.repeats = 2;
  settings_.max_depth = settings.max_depth;
  settings_.seed = settings.seed;
  estimator_ = derivatives::make_estimator("aware", world_, settings_);
}

Record RestRecordMaker::make(const Wish& wish, const Epoch* /*sources*/, RayCounters& counters) const {
  const derivatives::PointEstimate estimate = derivatives::average(*estimator_, settings_, wish.position);
  counters.closest_hit += estimate.samples;
  Record record;
  record.position = wish.position;
  record.component = wish.component;
  const derivatives::Jet3d luminance = estimate.mean.luminance();
  for (int c = 0; c < 3; ++c) {
    const derivatives::Jet3d& channel = estimate.mean.channels[static_cast<size_t>(c)];
    record.radiance[c] = std::fmax(static_cast<float>(channel.value), 0.0f);
    record.gradient[static_cast<size_t>(c)] = Vec3f(channel.gradient);
  }
  for (size_t i = 0; i < 6; ++i) record.hessian.entries[i] = static_cast<float>(luminance.hessian.entries[i]);
  record.samples = static_cast<uint32_t>(std::max<uint64_t>(estimate.samples, 1));
  record.variance =
      static_cast<float>(estimate.luminance_standard_error.value * estimate.luminance_standard_error.value);
  const scene::Intersector& intersector = *world_->scene().intersector;
  for (uint32_t i = 0; i < 8 * 16; ++i) {
    const Vec2f u((static_cast<float>(i % 16) + 0.5f) / 16, (static_cast<float>(i / 16) + 0.5f) / 8);
    const Vec3f direction = square_to_uniform_sphere(u);
    scene::Hit hit;
    ++counters.closest_hit;
    if (intersector.intersect_solid({wish.position, direction, infinity}, hit))
      record.depth.insert(direction, hit.distance);
  }
  record.id = content_id(record.position, record.component, "aware", settings_.seed);
  return record;
}

std::vector<Wish> RestRecordMaker::sources_of(const Wish& /*wish*/, int32_t /*count*/,
                                              RayCounters& /*counters*/) const {
  return {};
}

}  // namespace fogbank::cache
