// Rate of a growing counter over the last seconds.
#pragma once

#include <cstdint>
#include <deque>

#include "service/scheduling/clock.h"

namespace fogbank::service {

/// Not thread-safe.
class RateMeter {
 public:
  void record(uint64_t total, Clock::time_point now) {
    if (!samples_.empty() && now - samples_.back().time < spacing) return;
    samples_.push_back({now, total});
    while (samples_.size() > 2 && now - samples_[1].time > window) samples_.pop_front();
  }

  /// Per second; 0 before there are two samples.
  double rate() const {
    if (samples_.size() < 2) return 0;
    const double elapsed = to_seconds(samples_.back().time - samples_.front().time);
    return elapsed > 0 ? static_cast<double>(samples_.back().total - samples_.front().total) / elapsed : 0;
  }

 private:
  static constexpr Clock::duration spacing = std::chrono::milliseconds(250);
  static constexpr Clock::duration window = std::chrono::seconds(5);

  struct Sample {
    Clock::time_point time;
    uint64_t total = 0;
  };
  std::deque<Sample> samples_;
};

}  // namespace fogbank::service
