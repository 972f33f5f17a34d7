// How much of the disk some folders take.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <vector>

#include "service/scheduling/clock.h"

namespace fogbank::service {

/// Bytes of the files below some folders and of those that are about to be written. The folders are looked
/// through at most once a second; what is written through a Reservation counts at once. Thread-safe.
class DiskMeter {
 public:
  explicit DiskMeter(std::vector<std::filesystem::path> folders);

  int64_t used();

  /// Bytes that will be written; given back as they are, or with the object.
  class Reservation {
   public:
    Reservation() = default;
    Reservation(DiskMeter& meter, int64_t bytes);
    ~Reservation();
    Reservation(Reservation&& other) noexcept;
    Reservation& operator=(Reservation&& other) noexcept;

    void written(int64_t bytes);

   private:
    DiskMeter* meter_ = nullptr;
    int64_t bytes_ = 0;
  };

 private:
  const std::vector<std::filesystem::path> folders_;
  std::mutex mutex_;
  int64_t found_ = 0;
  int64_t written_since_ = 0;
  int64_t reserved_ = 0;
  Clock::time_point next_look_;
};

}  // namespace fogbank::service
