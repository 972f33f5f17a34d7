#include "service/disk_meter.h"

#include <system_error>
#include <utility>

namespace fogbank::service {

namespace fs = std::filesystem;

namespace {

/// What vanishes meanwhile doesn't count.
int64_t size_below(const fs::path& folder) {
  int64_t total = 0;
  std::error_code error;
  for (fs::recursive_directory_iterator entry(folder, error); !error && entry != fs::end(entry);
       entry.increment(error)) {
    std::error_code gone;
    if (!entry->is_regular_file(gone)) continue;
    const uintmax_t size = entry->file_size(gone);
    if (!gone) total += static_cast<int64_t>(size);
  }
  return total;
}

}  // namespace

DiskMeter::DiskMeter(std::vector<fs::path> folders) : folders_(std::move(folders)) {}

int64_t DiskMeter::used() {
  const std::lock_guard lock(mutex_);
  const Clock::time_point now = Clock::now();
  if (now >= next_look_) {
    found_ = 0;
    written_since_ = 0;
    for (const fs::path& folder : folders_) found_ += size_below(folder);
    next_look_ = now + std::chrono::seconds(1);
  }
  return found_ + written_since_ + reserved_;
}

DiskMeter::Reservation::Reservation(DiskMeter& meter, int64_t bytes) : meter_(&meter), bytes_(bytes) {
  const std::lock_guard lock(meter.mutex_);
  meter.reserved_ += bytes;
}

DiskMeter::Reservation::~Reservation() {
  if (meter_ == nullptr) return;
  const std::lock_guard lock(meter_->mutex_);
  meter_->reserved_ -= bytes_;
}

DiskMeter::Reservation::Reservation(Reservation&& other) noexcept
    : meter_(std::exchange(other.meter_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}

DiskMeter::Reservation& DiskMeter::Reservation::operator=(Reservation&& other) noexcept {
  std::swap(meter_, other.meter_);
  std::swap(bytes_, other.bytes_);
  return *this;
}

void DiskMeter::Reservation::written(int64_t bytes) {
  if (meter_ == nullptr) return;
  const std::lock_guard lock(meter_->mutex_);
  meter_->reserved_ -= bytes;
  meter_->written_since_ += bytes;
  bytes_ -= bytes;
}

}  // namespace fogbank::service
