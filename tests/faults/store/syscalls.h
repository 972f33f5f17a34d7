// Stands between the stores and the kernel: counts their calls, makes one fail, and knows what a power cut
// would take.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace fogbank::faults {

/// What happens to the chosen call.
enum class Fault : uint8_t {
  none,
  no_space,          ///< ENOSPC
  no_space_anymore,  ///< ENOSPC, and every call after it
  io_error,          ///< EIO
  no_descriptors,    ///< EMFILE of open, ENOSPC of others
  short_write,       ///< one byte of a write, EINTR of others that may be interrupted
};

/// From now on calls below `folder` (open, mkdir, write, fsync, rename, truncate, unlink) are counted from 1,
/// and number `number` has `fault`; 0: none does. Thread-safe.
void watch_calls(const std::filesystem::path& folder, Fault fault, int64_t number);
/// Nothing fails any more; the number of calls since.
int64_t stop_watching();

/// What a power cut now could take of `path`, entries of folders above it included, since `watch_calls`:
/// descriptions, none when the file is safe.
std::vector<std::string> lost_at_power_cut(const std::filesystem::path& path);

}  // namespace fogbank::faults
