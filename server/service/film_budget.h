// Memory for films, shared by all tenants.
#pragma once

#include <cstdint>
#include <mutex>

namespace fogbank::service {

/// Thread-safe.
class FilmBudget {
 public:
  explicit FilmBudget(int64_t bytes) : total_(bytes) {}

  int64_t total() const { return total_; }
  /// False, and nothing is taken, when there is not so much left.
  bool take(int64_t bytes) {
    const std::lock_guard lock(mutex_);
    if (bytes > total_ - used_) return false;
    used_ += bytes;
    return true;
  }
  void give_back(int64_t bytes) {
    const std::lock_guard lock(mutex_);
    used_ -= bytes;
  }

 private:
  const int64_t total_;
  std::mutex mutex_;
  int64_t used_ = 0;
};

}  // namespace fogbank::service
