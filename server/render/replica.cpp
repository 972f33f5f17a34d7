#include "render/replica.h"

#include <chrono>
#include <utility>

#include "core/error.h"
#include "core/thread_time.h"
#include "render/job_integrator.h"
#include "render/tile_samples.h"
#include "scene/intersector.h"
#include "transport/world.h"

namespace fogbank::render {

namespace {

using SteadyClock = std::chrono::steady_clock;

/// So long a thread that waits for others doesn't look whether its own task is still wanted.
constexpr std::chrono::milliseconds patience{20};

[[noreturn]] void refuse_log(const std::string& why) {
  throw Error(ErrorKind::invalid_argument, "INVALID_LOG", "the log can't be replayed: " + why);
}

[[noreturn]] void refuse_task(const std::string& why) {
  throw Error(ErrorKind::invalid_argument, "INVALID_TASK", why);
}

[[noreturn]] void behind(uint64_t length) {
  throw Error(ErrorKind::failed_precondition, "REPLICA_BEHIND",
              "the replica has replayed " + std::to_string(length) + " entries of the log only");
}

[[noreturn]] void diverged(const char* what, uint64_t here, uint64_t there) {
  throw Error(ErrorKind::internal, "REPLICA_DIVERGED",
              "the replica has " + std::to_string(here) + " " + what + ", the job " + std::to_string(there));
}

bool same(const integrators::PassSamples& a, const integrators::PassSamples& b) {
  return a.seed == b.seed && a.first == b.first && a.count == b.count;
}

}  // namespace

Replica::Replica(std::shared_ptr<const transport::World> world, RenderSettings settings)
    : world_(std::move(world)), settings_(std::move(settings)), camera_(settings_.sensor, settings_.film) {
  settings_.reference = nullptr;
  settings_.integrator_settings.cache = nullptr;
  make_job_integrator(world_, settings_);
}

Replica::~Replica() = default;

uint64_t Replica::log_length() const {
  const std::lock_guard lock(mutex_);
  return length_;
}

void Replica::advance(uint64_t index, std::string_view entry) {
  const std::lock_guard one_at_a_time(advancing_);
  if (index < reader_.length()) return;
  if (index > reader_.length()) behind(reader_.length());
  const std::optional<LogStep> step = reader_.read(entry);
  std::unique_lock lock(mutex_);
  if (step) {
    advancing_now_ = true;
    unwanted_ = true;
    changed_.wait(lock, [&] { return running_.empty(); });
    lock.unlock();
    std::exception_ptr failure;
    try {
      scene::prepare_render_thread();
      apply(*step);
    } catch (...) {
      failure = std::current_exception();
    }
    lock.lock();
    advancing_now_ = false;
    unwanted_ = false;
    changed_.notify_all();
    if (failure) std::rethrow_exception(failure);
    ++steps_;
  }
  length_ = reader_.length();
}

void Replica::apply(const LogStep& step) {
  if (std::holds_alternative<StartStep>(step) != (steps_ == 0))
    refuse_log("its first step, and no other, has the records there were");
  std::visit([&](const auto& kind) { apply_step(kind); }, step);
}

void Replica::apply_step(const StartStep& step) {
  cache_ = std::make_shared<cache::SceneCache>(std::make_shared<const cache::RecordSet>(step.records));
  settings_.integrator_settings.cache = cache_;
  integrator_ = make_job_integrator(world_, settings_);
}

void Replica::apply_step(const BeginStep& step) {
  if (preparation_) refuse_log("a preparation begins in another one");
  preparation_ = integrator_->prepare(camera_, step.target);
  if (!preparation_) refuse_log("there is nothing to prepare");
  round_tasks_ = 0;
}

void Replica::apply_step(const RoundStep& step) {
  if (!preparation_) refuse_log("a round without a preparation");
  preparation_->adopt(step.outcome);
  round_tasks_ = preparation_->next_round();
  if (round_tasks_ == 0) preparation_ = nullptr;
  if (round_tasks_ != step.next_tasks) diverged("tasks", round_tasks_, step.next_tasks);
  expect_records(step.records);
}

void Replica::apply_step(const DropStep& step) {
  if (!preparation_) refuse_log("a preparation that never began is dropped");
  preparation_->adopt(step.outcome);
  preparation_ = nullptr;
  expect_records(step.records);
}

void Replica::expect_records(uint64_t wanted) const {
  if (const uint64_t records = cache_->records()->size(); records != wanted)
    diverged("records", records, wanted);
}

bool Replica::enter(const LeasedTask& task, uint32_t step, const std::atomic<bool>& stop) {
  std::unique_lock lock(mutex_);
  for (;;) {
    if (stop) throw Interrupted();
    if (!advancing_now_) {
      if (step > steps_ || steps_ == 0) behind(length_);
      if (step < steps_ || task.stage < stage_) return false;
      if (task.stage == stage_ && !running_.contains(task.index)) break;
      if (task.stage > stage_) {
        if (running_.empty()) {
          stage_ = task.stage;
          unwanted_ = false;
          break;
        }
        unwanted_ = true;
      }
    }
    changed_.wait_for(lock, patience);
  }
  running_.insert(task.index);
  return true;
}

void Replica::leave(const LeasedTask& task) {
  const std::lock_guard lock(mutex_);
  running_.erase(task.index);
  changed_.notify_all();
}

std::optional<TaskResult> Replica::perform(const LeasedTask& task, const std::atomic<bool>& stop) {
  scene::prepare_render_thread();
  TaskInput input = task_input(task.input);
  if (!enter(task, input.step, stop)) return std::nullopt;
  try {
    TaskResult result = run(input, stop);
    leave(task);
    return result;
  } catch (const Interrupted&) {
    leave(task);
    if (stop) throw;
    return std::nullopt;
  } catch (...) {
    leave(task);
    throw;
  }
}

TaskResult Replica::run(TaskInput& input, const std::atomic<bool>& stop) {
  const SteadyClock::time_point start = SteadyClock::now();
  const double cpu_start = thread_cpu_seconds();
  RayCounters counters{.stop = &stop, .unwanted = &unwanted_};
  TaskResult result;
  result.bytes =
      std::visit([&](auto& what) { return run(what, counters, result.invalid_samples); }, input.what);
  result.rays = counters.total();
  result.seconds = std::chrono::duration<double>(SteadyClock::now() - start).count();
  result.cpu_seconds = thread_cpu_seconds() - cpu_start;
  return result;
}

std::string Replica::run(const PreparationInput& input, RayCounters& counters, uint64_t&) {
  if (!preparation_ || input.task >= round_tasks_) refuse_task("the round has no such task");
  counters.poll();
  preparation_->run(input.task, counters);
  return preparation_->result(input.task);
}

std::string Replica::run(const SurveyInput& input, RayCounters& counters, uint64_t&) {
  const std::shared_ptr<const CacheSurvey> rows = survey(input);
  if (input.row >= rows->rows()) refuse_task("the survey has no such row");
  return CacheSurvey::bytes_of(rows->look(input.row, *integrator_, camera_, settings_.seed, counters));
}

std::string Replica::run(TileInput& input, RayCounters& counters, uint64_t& invalid_samples) {
  const TileTask& task = input.task;
  prepare_pass({.seed = settings_.seed, .first = task.first_sample, .count = task.sample_count}, counters);
  invalid_samples = add_samples(task, *integrator_, camera_, settings_.seed, counters, input.film);
  return bytes_of(input.film);
}

std::shared_ptr<const CacheSurvey> Replica::survey(const SurveyInput& input) {
  const std::lock_guard lock(mutex_);
  if (!survey_ || survey_->stride() != input.stride || survey_->channels() != input.channels)
    survey_ = std::make_shared<const CacheSurvey>(settings_.film.crop, input.stride, input.channels);
  return survey_;
}

void Replica::prepare_pass(const integrators::PassSamples& samples, RayCounters& counters) {
  std::unique_lock lock(mutex_);
  for (;;) {
    counters.poll();
    if (!pass_ || !same(*pass_, samples)) {
      // Others may be busy with that one.
      if (pass_ && pass_stage_ == stage_) refuse_task("tiles of two passes in one stage");
      pass_stage_ = stage_;
      pass_ready_ = false;
      pass_preparation_ = integrator_->prepare_pass(camera_, samples);
      pass_ = samples;
      begin_pass_round();
    }
    if (pass_ready_) return;
    const std::optional<RoundTask> task = pass_rounds_.take();
    if (!task || !pass_rounds_.begin(*task)) {
      changed_.wait_for(lock, patience);
      continue;
    }
    lock.unlock();
    try {
      pass_preparation_->run(task->index, counters);
    } catch (...) {
      lock.lock();
      pass_rounds_.end(*task, false);
      throw;
    }
    lock.lock();
    if (pass_rounds_.end(*task, true)) begin_pass_round();
    changed_.notify_all();
  }
}

void Replica::begin_pass_round() {
  uint32_t tasks = 0;
  try {
    if (pass_preparation_) tasks = pass_preparation_->next_round();
  } catch (...) {
    pass_.reset();
    throw;
  }
  pass_rounds_.begin_round(tasks);
  if (tasks > 0) return;
  pass_preparation_ = nullptr;
  pass_ready_ = true;
}

}  // namespace fogbank::render
