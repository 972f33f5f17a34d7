#include "service/scheduling/scheduler.h"

#include <pthread.h>

#include <algorithm>
#include <optional>
#include <tuple>
#include <utility>

namespace fogbank::service {

Scheduler::Scheduler(int threads, std::function<void()> prepare_thread)
    : prepare_thread_(std::move(prepare_thread)) {
  threads_.reserve(static_cast<size_t>(threads));
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

Scheduler::~Scheduler() { close(); }

void Scheduler::add(std::shared_ptr<Workload> workload) {
  auto entry = std::make_shared<Entry>();
  entry->workload = std::move(workload);
  const int number = entry->workload->group();
  {
    const std::lock_guard lock(mutex_);
    std::optional<double> least;
    for (const auto& other : entries_) {
      if (other->workload == entry->workload) return;
      if (other->workload->group() == number && other->workload->urgency() == entry->workload->urgency())
        least = std::min(other->virtual_time(), least.value_or(other->virtual_time()));
    }
    entry->head_start = least.value_or(0);
    Group& group = groups_[number];
    if (group.workloads == 0) {
      // Level with the least served group; one that had got ahead does not lose that by pausing.
      std::optional<double> least_group;
      for (const auto& [other_number, other] : groups_) {
        if (other.workloads > 0)
          least_group = std::min(other.virtual_time(), least_group.value_or(other.virtual_time()));
      }
      group.time = std::max(group.time, least_group.value_or(group.time));
    }
    ++group.workloads;
    entries_.push_back(std::move(entry));
  }
  wake_.notify_all();
}

void Scheduler::remove(const Workload& workload) {
  const std::lock_guard lock(mutex_);
  if (std::erase_if(entries_, [&](const auto& entry) { return entry->workload.get() == &workload; }) > 0)
    --groups_[workload.group()].workloads;
}

void Scheduler::wake() {
  // The lock makes sure that no thread is between its look at the workloads and its wait.
  { const std::lock_guard lock(mutex_); }
  wake_.notify_all();
}

int Scheduler::busy() const {
  const std::lock_guard lock(mutex_);
  return busy_;
}

void Scheduler::hold(int group, bool held) {
  {
    const std::lock_guard lock(mutex_);
    if (std::exchange(groups_[group].held, held) == held) return;
  }
  wake_.notify_all();
}

double Scheduler::cpu_seconds(int group) const {
  const std::lock_guard lock(mutex_);
  const auto found = groups_.find(group);
  return found == groups_.end() ? 0 : found->second.cpu_seconds;
}

double Scheduler::consumed_seconds(const Workload& workload) const {
  const std::lock_guard lock(mutex_);
  for (const auto& entry : entries_) {
    if (entry->workload.get() == &workload) return entry->consumed;
  }
  return 0;
}

void Scheduler::close() {
  {
    const std::lock_guard lock(mutex_);
    closed_ = true;
  }
  wake_.notify_all();
  for (std::thread& thread : threads_) {
    if (thread.joinable()) thread.join();
  }
}

std::pair<std::shared_ptr<Scheduler::Entry>, std::function<void()>> Scheduler::take() {
  // Ties go to the earlier arrival: stable order, no dependence on addresses.
  std::vector<std::shared_ptr<Entry>> order = entries_;
  std::ranges::stable_sort(order, {}, [this](const auto& entry) {
    const int group = entry->workload->group();
    return std::tuple(groups_.at(group).virtual_time(), group, entry->workload->urgency(),
                      entry->virtual_time());
  });
  for (const std::shared_ptr<Entry>& entry : order) {
    if (groups_.at(entry->workload->group()).held) continue;
    if (entry->running >= entry->workload->max_threads()) continue;
    if (std::function<void()> task = entry->workload->take()) return {entry, std::move(task)};
  }
  return {};
}

void Scheduler::work() {
  pthread_setname_np(pthread_self(), "render");
  prepare_thread_();
  std::unique_lock lock(mutex_);
  while (!closed_) {
    auto [entry, task] = take();
    if (!task) {
      wake_.wait(lock);
      continue;
    }
    ++entry->running;
    ++busy_;
    Group& group = groups_.at(entry->workload->group());
    const double in_advance = entry->last_task;
    group.in_advance += in_advance;
    lock.unlock();
    const Clock::time_point start = Clock::now();
    const double cpu_before = thread_cpu_seconds();
    task();
    task = nullptr;
    const double elapsed = to_seconds(Clock::now() - start);
    const double cpu = thread_cpu_seconds() - cpu_before;
    lock.lock();
    --entry->running;
    --busy_;
    entry->consumed += elapsed;
    group.in_advance -= in_advance;
    group.time += elapsed;
    group.cpu_seconds += cpu;
    entry->last_task = elapsed;
    // The end of a task may begin a new pass, which has tasks for everybody who waits.
    wake_.notify_all();
    if (entry.use_count() == 1) {
      // Removed meanwhile; the workload's destructor may be long and may call the scheduler.
      lock.unlock();
      entry.reset();
      lock.lock();
    }
  }
}

}  // namespace fogbank::service
