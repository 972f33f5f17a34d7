#include "render/task_rounds.h"

namespace fogbank::render {

void TaskRounds::begin_round(uint32_t tasks) {
  ++round_;
  returned_.clear();
  next_ = 0;
  done_ = 0;
  tasks_.assign(tasks, State::waiting);
}

std::optional<RoundTask> TaskRounds::take() {
  if (!returned_.empty()) {
    const uint32_t task = returned_.back();
    returned_.pop_back();
    return RoundTask{round_, task};
  }
  if (next_ >= tasks_.size()) return std::nullopt;
  return RoundTask{round_, next_++};
}

bool TaskRounds::begin(const RoundTask& task) {
  if (task.round != round_ || task.index >= tasks_.size() || tasks_[task.index] != State::waiting)
    return false;
  tasks_[task.index] = State::running;
  return true;
}

bool TaskRounds::end(const RoundTask& task, bool done, bool keeps) {
  tasks_[task.index] = done ? State::done : State::waiting;
  if (!done) {
    if (!keeps) returned_.push_back(task.index);
    return false;
  }
  return ++done_ == tasks_.size();
}

void TaskRounds::recall() {
  returned_.clear();
  for (uint32_t task = next_; task-- > 0;)
    if (tasks_[task] == State::waiting) returned_.push_back(task);
}

}  // namespace fogbank::render
