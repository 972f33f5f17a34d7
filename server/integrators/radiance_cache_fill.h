// Filling the cache for a camera: rounds that look for places that no record reaches, and rounds that make
// records there. Each round sees the frozen result of the one before, so the records are a function of scene,
// camera, settings and the records there were, whatever the threads.
#pragma once

#include <map>
#include <vector>

#include "cache/thinning.h"
#include "integrators/radiance_cache.h"

namespace fogbank::integrators {

class RadianceCacheFill final : public Preparation {
 public:
  RadianceCacheFill(RadianceCacheIntegrator& integrator, const CameraRays& camera, const CacheTarget& target);

  uint32_t next_round() override;
  void run(uint32_t task, RayCounters& counters) override;
  double fraction() const override;

 private:
  /// Pilot once a job; then, stride after stride of pixels, probing and making until nothing is uncovered.
  enum class Round : uint8_t { begin, pilot, probing, making, done };

  uint32_t begin_probing();
  /// Camera rays through a band of pixels, `stride_` apart.
  void probe(uint32_t band, RayCounters& counters);
  void grant_wishes();
  uint64_t records_left() const;  ///< that the job may still make
  void publish();

  RadianceCacheIntegrator& integrator_;
  const CameraRays& camera_;
  CacheTarget target_;
  std::map<cache::Quantity, std::unique_ptr<const cache::RecordMaker>> makers_;
  Round round_ = Round::begin;
  int32_t stride_ = 0;
  int32_t attempts_ = 0;                               ///< rounds of making at this stride
  std::vector<std::vector<cache::SpacedWish>> found_;  ///< by band
  std::vector<cache::Wish> granted_;
  std::vector<cache::Record> made_;  ///< one for each of granted_
};

}  // namespace fogbank::integrators
