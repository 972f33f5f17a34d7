// The one clock of everything that waits: monotonic, so that a change of the machine's time moves no
// deadline.
#pragma once

#include <chrono>
#include <ctime>

namespace fogbank::service {

using Clock = std::chrono::steady_clock;

inline Clock::duration seconds(double value) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
}

inline double to_seconds(Clock::duration value) { return std::chrono::duration<double>(value).count(); }

/// CPU time that the calling thread has used.
inline double thread_cpu_seconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace fogbank::service
