// Filling the cache for a camera: rounds that look for places that no record reaches, and rounds that make
// records there. Each round sees the frozen result of the one before, so the records are a function of scene,
// camera, settings and the records there were, whatever the threads.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <vector>

#include "cache/store/bytes.h"
#include "cache/thinning.h"
#include "integrators/radiance_cache.h"
#include "integrators/record_noise.h"

namespace fogbank::integrators {

class RadianceCacheFill final : public Preparation {
 public:
  RadianceCacheFill(RadianceCacheIntegrator& integrator, const CameraRays& camera, const CacheTarget& target);
  /// Records of a round that was dropped are kept as far as they are done.
  ~RadianceCacheFill() override;
  RadianceCacheFill(const RadianceCacheFill&) = delete;
  RadianceCacheFill& operator=(const RadianceCacheFill&) = delete;

  /// In place of all rounds: publishes what the cache holds, as the target wants it seen. Needs the pilot.
  void publish_as_it_is(uint8_t generation);

  uint32_t next_round() override;
  void run(uint32_t task, RayCounters& counters) override;
  double fraction() const override;
  uint32_t round_kind() const override { return static_cast<uint32_t>(round_); }

  // radiance_cache_fill_results.cpp:

  std::string result(uint32_t task) const override;
  void accept(uint32_t task, std::string_view result) override;
  std::string outcome() override;
  void adopt(std::string_view outcome) override;

 private:
  /// Pilot once a job; then, stride after stride of pixels, probing and making until nothing is uncovered.
  /// In the end places that make noise get further records, each of four times the samples of the one before.
  enum class Round : uint8_t { begin, pilot, probing, making, surveying, refining, done };

  /// What the round's results come to: which records are granted. Once a round.
  void settle();
  /// Throw as `accept` for what the scene and the fill know nothing of.
  void check(const cache::Component& component, uint8_t generation) const;
  std::vector<cache::Wish> take_wishes(cache::ByteReader& reader, uint8_t generation) const;
  static void check_granted(const cache::Record& record, const cache::Wish& wish);

  /// Of the records that the camera is to see; needs the pilot.
  void choose_generation();
  /// Of a round that looks at the camera's rays, a band of pixels a task.
  uint32_t begin_bands(Round round);
  uint32_t begin_surveying();
  uint32_t begin_making(Round round);
  /// Camera rays through a band of pixels, `stride_` apart, looked at by `observer`; `end_ray()` after each.
  template <typename EndRay>
  void observe_band(uint32_t band, LookUpObserver& observer, const EndRay& end_ray,
                    RayCounters& counters) const;
  void grant_wishes();
  /// By the noise that was surveyed.
  void grant_refinements();
  /// Record number `level` of a place. Makes the maker if need be: not while tasks run.
  void need_maker(const cache::Component& component, uint32_t level);
  const cache::RecordMaker& maker(const cache::Component& component, uint32_t level = 0) const;
  /// The granted record, where one made it already, in vain, before the job was interrupted; else a new one.
  cache::Record make_granted(uint32_t number, RayCounters& counters) const;
  uint64_t records_left() const;  ///< that the job may still make
  uint64_t add_made();            ///< to the cache; how many were new
  void leave_unfinished();
  void publish();
  PilotedMetric pilot_metric(double error) const;
  double scene_radius() const;  ///< > 0
  cache::MetricSettings metric_of(const PilotedMetric& piloted) const;

  RadianceCacheIntegrator& integrator_;
  const CameraRays& camera_;
  CacheTarget target_;
  PublishedCache before_;  ///< by the last finished preparation; no epoch: there was none
  /// By quantity, whether their paths end among photons, and level.
  std::map<std::tuple<cache::Quantity, bool, uint32_t>, std::unique_ptr<const cache::RecordMaker>> makers_;
  uint8_t generation_ = 0;   ///< that the camera is to see
  double direct_floor_ = 1;  ///< cache::MetricSettings::direct_floor
  Round round_ = Round::begin;
  bool settled_ = false;
  int32_t stride_ = 0;
  int32_t attempts_ = 0;                               ///< rounds of making at this stride
  std::vector<std::vector<cache::SpacedWish>> found_;  ///< by band
  std::vector<RecordNoise> noise_;                     ///< by band
  int32_t refinements_ = 0;
  std::vector<cache::Wish> granted_;
  std::vector<uint32_t> levels_;     ///< of granted_
  std::vector<cache::Record> made_;  ///< one for each of granted_
};

}  // namespace fogbank::integrators
