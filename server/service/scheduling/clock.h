// The one clock of everything that waits: monotonic, so that a change of the machine's time moves no
// deadline.
#pragma once

#include <chrono>

namespace fogbank::service {

using Clock = std::chrono::steady_clock;

inline Clock::duration seconds(double value) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
}

inline double to_seconds(Clock::duration value) { return std::chrono::duration<double>(value).count(); }

}  // namespace fogbank::service
