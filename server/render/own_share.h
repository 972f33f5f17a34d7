// Which stages of a leased job the coordinator performs itself: those whose tasks would take one of its
// threads less time than bringing them to a replica and back. What a stage costs is predicted by tasks of the
// same kind before; who performs what never changes image or records. Not thread-safe: the job's mutex guards
// it.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>

namespace fogbank::render {

class OwnShare {
 public:
  using Clock = std::chrono::steady_clock;

  /// Seconds that a task takes to a replica and back, besides its performance; 0 (as at first): all stages
  /// are leased. Counts from the next stage on; when it is said for the first time, for the present one, too.
  void set_trip_seconds(double seconds, Clock::time_point now);

  /// Tasks of stages of one `kind` take about as long for each unit of `work`, which is all of the stage's. A
  /// kind of which nothing is known is tried.
  void begin_stage(uint32_t kind, double work, Clock::time_point now);
  /// All stages until the next `begin_stage` are leased.
  void begin_leased_stage();
  /// A task of the stage is done, by whomever.
  void learn(double work, double cpu_seconds, Clock::time_point now);
  /// Whether the coordinator's threads have the stage's tasks to themselves: until they are found to take too
  /// long.
  bool keeps(Clock::time_point now) const { return now < kept_until_; }
  Clock::time_point kept_until() const { return kept_until_; }

 private:
  void keep(Clock::time_point now);
  void judge(Clock::time_point now);

  std::optional<double> trip_seconds_;
  std::map<uint32_t, double> unit_seconds_;  ///< by kind: CPU time of one unit of work
  uint32_t kind_ = 0;
  double work_left_ = 0;
  Clock::time_point kept_until_{};
};

}  // namespace fogbank::render
