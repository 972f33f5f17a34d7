#include "render/preparation_rounds.h"

namespace fogbank::render {

void PreparationRounds::begin_round(uint32_t tasks) {
  ++round_;
  returned_.clear();
  next_ = 0;
  done_ = 0;
  tasks_.assign(tasks, State::waiting);
}

std::optional<PreparationTask> PreparationRounds::take() {
  if (!returned_.empty()) {
    const uint32_t task = returned_.back();
    returned_.pop_back();
    return PreparationTask{round_, task};
  }
  if (next_ >= tasks_.size()) return std::nullopt;
  return PreparationTask{round_, next_++};
}

bool PreparationRounds::begin(const PreparationTask& task) {
  if (task.round != round_ || task.task >= tasks_.size() || tasks_[task.task] != State::waiting) return false;
  tasks_[task.task] = State::running;
  return true;
}

bool PreparationRounds::end(const PreparationTask& task, bool done) {
  tasks_[task.task] = done ? State::done : State::waiting;
  if (!done) {
    returned_.push_back(task.task);
    return false;
  }
  return ++done_ == tasks_.size();
}

}  // namespace fogbank::render
