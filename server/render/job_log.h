// All that a replica needs to follow a leased job: what came of its preparations, step by step.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "cache/record_set.h"
#include "integrators/integrator.h"

namespace fogbank::render {

/// The first step: the records there were. Always the first, and once.
struct StartStep {
  cache::RecordSet records;
};

/// A preparation begins.
struct BeginStep {
  integrators::CacheTarget target;
};

/// A round of it is complete; the first one of each has no tasks and no outcome.
struct RoundStep {
  std::string outcome;      ///< Preparation::outcome
  uint32_t next_tasks = 0;  ///< Preparation::next_round
  uint64_t records = 0;     ///< in the job's cache then
};

/// It is dropped for want of time.
struct DropStep {
  std::string outcome;   ///< of the unfinished round
  uint64_t records = 0;  ///< in the job's cache then
};

using LogStep = std::variant<StartStep, BeginStep, RoundStep, DropStep>;

/// Steps cut into entries that fit into messages. Grows only; what was read never changes. Thread-safe.
class JobLog {
 public:
  static constexpr size_t most_entry_bytes = size_t{1} << 20;
  /// As much as the records of some million places; a job that needs more fails.
  static constexpr size_t most_bytes = size_t{1} << 30;

  struct Entry {
    std::string data;
    std::string sha256;  ///< of `data`, 64 hexadecimal digits
  };

  /// Throws Error(resource_exhausted, "LOG_TOO_LARGE").
  void add(const LogStep& step);
  uint32_t steps() const;
  uint64_t length() const;  ///< entries
  /// index < length()
  std::shared_ptr<const Entry> entry(uint64_t index) const;

 private:
  mutable std::mutex mutex_;
  std::vector<std::shared_ptr<const Entry>> entries_;
  size_t bytes_ = 0;
  uint32_t steps_ = 0;
};

/// Puts steps together again.
class JobLogReader {
 public:
  /// Of the next entry; the step that it completes, if any. Throws Error(invalid_argument, "INVALID_LOG"),
  /// and is as before.
  std::optional<LogStep> read(std::string_view entry);
  uint64_t length() const { return length_; }  ///< entries read

 private:
  std::string part_;  ///< of the step that isn't complete
  uint64_t length_ = 0;
};

}  // namespace fogbank::render
