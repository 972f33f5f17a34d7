// Rounds of independent tasks, each numbered from 0. Not thread-safe: the job's mutex guards it.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "render/task.h"

namespace fogbank::render {

class TaskRounds {
 public:
  /// While no task runs.
  void begin_round(uint32_t tasks);
  /// A task that nobody has, if any.
  std::optional<RoundTask> take();
  /// False when it isn't of this round, runs already or is done.
  bool begin(const RoundTask& task);
  /// Ends what `begin` began. True when that completed the round. What isn't done can be taken again, unless
  /// `keeps`: whoever took it tries again.
  bool end(const RoundTask& task, bool done, bool keeps = false);
  /// Whoever took tasks has gone: those that neither run nor are done can be taken again.
  void recall();
  uint32_t round() const { return round_; }
  uint32_t count() const { return static_cast<uint32_t>(tasks_.size()); }

 private:
  enum class State : uint8_t { waiting, running, done };

  uint32_t round_ = 0;
  std::vector<State> tasks_;
  uint32_t next_ = 0;
  std::vector<uint32_t> returned_;
  uint32_t done_ = 0;
};

}  // namespace fogbank::render
