// What a computation that traces rays shares with whoever asked for it.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <exception>

namespace fogbank {

/// Thrown where a computation finds that its result isn't wanted any more.
class Interrupted : public std::exception {
 public:
  const char* what() const noexcept override { return "interrupted"; }
};

/// Counters of one thread; added up when a tile is done.
struct RayCounters {
  uint64_t closest_hit = 0;
  uint64_t any_hit = 0;
  /// Set from outside once the result isn't wanted any more; by whoever runs this, and by whoever wants it.
  const std::atomic<bool>* stop = nullptr;
  const std::atomic<bool>* unwanted = nullptr;
  /// The result comes too late then; max: never, and the clock isn't read.
  std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max();

  uint64_t total() const { return closest_hit + any_hit; }
  /// Throws Interrupted when one of them is set or the deadline is over. Called once a path where a
  /// computation takes many.
  void poll() const {
    if (stop != nullptr && stop->load(std::memory_order_relaxed)) throw Interrupted();
    if (unwanted != nullptr && unwanted->load(std::memory_order_relaxed)) throw Interrupted();
    if (deadline != std::chrono::steady_clock::time_point::max() &&
        std::chrono::steady_clock::now() >= deadline) {
      throw Interrupted();
    }
  }
  /// As `poll`, at every 1024th step: for long loops over what takes microseconds.
  void poll_at(size_t step) const {
    if (step % 1024 == 0) poll();
  }
};

}  // namespace fogbank
