#include "service/job_table.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/failpoint.h"
#include "core/files.h"
#include "core/sha256.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"
#include "service/reference_image.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

/// Of the database, in a folder that is made if absent.
fs::path database_in(const fs::path& folder) {
  create_folder_durably(folder);
  return folder / "jobs.sqlite";
}

void add(JobTable::Totals& totals, const v1::Progress& progress) {
  totals.rays += progress.rays();
  totals.records_new += progress.records_new();
  totals.records_reused += progress.records_reused();
}

}  // namespace

JobTable::JobTable(Settings settings, SceneRegistry& scenes, CacheRegistry& caches, BlobStore& blobs,
                   TenantQuota& quota, Scheduler& scheduler, TaskQueue& writer, FilmBudget& films,
                   std::function<void()> films_freed, std::function<void()> changed)
    : settings_(std::move(settings)),
      scenes_(scenes),
      caches_(caches),
      blobs_(blobs),
      quota_(quota),
      scheduler_(scheduler),
      films_(films),
      films_freed_(std::move(films_freed)),
      store_(database_in(settings_.folder)),
      services_{
          .store = store_,
          .folder = settings_.folder,
          .writer = writer,
          .changed = std::move(changed),
          .ended = [this](const std::shared_ptr<Job>& job) { on_stopped(job); },
          .suspended = [this](const std::shared_ptr<Job>& job) { on_stopped(job); },
          .settle = [this](const std::shared_ptr<Job>& job) { settle(job); },
          .keep_epoch = [&caches](const scene::FieldIdentity& field) { return caches.keep_epoch(field); },
          .group = settings_.group,
          .task_limits = settings_.task_limits,
          .traces = settings_.traces} {
  restore();
}

RpcError JobTable::too_large(const Job& job) const {
  return {StatusCode::RESOURCE_EXHAUSTED,
          "IMAGE_TOO_LARGE",
          "the film needs " + std::to_string(job.film_bytes()) + " bytes of memory; this server has " +
              std::to_string(films_.total()) + " for films",
          {{"field", "settings.crop"}}};
}

void JobTable::create(const v1::CreateJobRequest& request, std::optional<TraceContext> client, Created done) {
  check_request_id(request.request_id());
  const std::string scene_id = parse_scene_name(request.scene());
  const std::string hash = sha256(canonical_bytes(request));
  const RpcError reused(StatusCode::ALREADY_EXISTS, "REQUEST_ID_REUSED",
                        "request_id was used before for another job", {{"field", "request_id"}});
  std::unique_lock lock(mutex_);
  if (shut_down_) throw shutting_down();
  if (const auto known = id_by_request_.find(request.request_id()); known != id_by_request_.end()) {
    const std::shared_ptr<Job> job = jobs_.at(known->second);
    if (job->request_hash() != hash) throw reused;
    lock.unlock();
    done(job, nullptr);
    return;
  }
  if (const auto creation = creating_.find(request.request_id()); creation != creating_.end()) {
    if (creation->second.request_hash != hash) throw reused;
    creation->second.waiting.push_back(std::move(done));
    return;
  }
  const size_t unfinished_jobs = waiting_.size() + active_.size() + creating_.size();
  if (unfinished_jobs >= static_cast<size_t>(limits::max_queued_jobs)) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_JOBS",
                   "there are as many unfinished jobs as the server takes; retry when some have ended",
                   {{"limit", "max_queued_jobs"}})
        .retry_after(limits::quota_retry_seconds);
  }
  quota_.require_job(unfinished_jobs);
  quota_.require_cpu();
  Creation creation{.request_hash = hash, .waiting = {}};
  creation.waiting.push_back(std::move(done));
  creating_.emplace(request.request_id(), std::move(creation));
  lock.unlock();
  const auto finish = [this, request, client = std::move(client)](
                          const std::shared_ptr<const transport::World>& world, double load_seconds,
                          std::exception_ptr error) {
    finish_creation(request, client, world, load_seconds, std::move(error));
  };
  try {
    scenes_.acquire(scene_id, finish);
  } catch (...) {
    finish(nullptr, 0, std::current_exception());
  }
}

std::shared_ptr<Job> JobTable::make_job(const v1::CreateJobRequest& request,
                                        std::optional<TraceContext> client, const scene::Scene& scene) {
  const JobSettings settings = resolve_settings(request.settings(), scene, scheduler_.threads());
  if (!v1::JobPriority_IsValid(request.priority())) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_SETTINGS", "priority is not a JobPriority",
                   {{"field", "priority"}});
  }
  if (request.fill_only()) check_fill_only(request, settings.effective);
  if (!settings.effective.reference_sha256().empty())
    load_reference(settings.effective.reference_sha256(), settings.engine.film.crop, blobs_,
                   scenes_.readers());
  if (settings.effective.has_epoch()) {
    caches_.at_epoch(cache::record_field(scene, settings.effective.max_depth()), settings.effective.epoch());
  }
  auto job = std::make_shared<Job>(new_job_id(), request, settings.effective, services_, std::move(client));
  if (job->film_bytes() > films_.total()) throw too_large(*job);
  quota_.require_stored(job->image_bytes());
  if (job->uses_cache()) quota_.require_cache(0);
  FOGBANK_FAILPOINT("job.before_create");
  store_.put({job->stored()});
  FOGBANK_FAILPOINT("job.after_create");
  return job;
}

void JobTable::finish_creation(const v1::CreateJobRequest& request, const std::optional<TraceContext>& client,
                               const std::shared_ptr<const transport::World>& world, double load_seconds,
                               std::exception_ptr error) {
  std::shared_ptr<Job> job;
  if (!error) {
    try {
      job = make_job(request, client, world->scene());
    } catch (...) {
      error = std::current_exception();
    }
  }
  Creation creation;
  bool stopped = false;
  {
    const std::lock_guard lock(mutex_);
    creation = std::move(creating_.extract(request.request_id()).mapped());
    if (job) {
      jobs_.emplace(job->id(), job);
      id_by_request_.emplace(request.request_id(), job->id());
      load_seconds_[job->id()] = load_seconds;
      waiting_.push_back(job);
      stopped = shut_down_;
    }
  }
  if (stopped) stop(*job);
  for (const Created& done : creation.waiting) done(job, error);
  admit();
  forget_old();
}

void JobTable::admit() {
  std::vector<std::shared_ptr<Job>> admitted;
  {
    const std::lock_guard lock(mutex_);
    while (!waiting_.empty()) {
      const std::shared_ptr<Job>& job = waiting_.front();
      if (!job->ended()) {
        if (!films_.take(job->film_bytes())) break;
        active_film_bytes_ += job->film_bytes();
        active_.emplace(job->id(), job);
        admitted.push_back(job);
      }
      waiting_.pop_front();
    }
  }
  for (const std::shared_ptr<Job>& job : admitted) start(job);
}

void JobTable::start(const std::shared_ptr<Job>& job) {
  double load_seconds = 0;
  {
    const std::lock_guard lock(mutex_);
    if (auto paid = load_seconds_.extract(job->id())) load_seconds = paid.mapped();
  }
  try {
    scenes_.acquire(job->scene_id(),
                    [this, job, load_seconds](const std::shared_ptr<const transport::World>& world,
                                              double more_seconds, std::exception_ptr error) {
                      if (error) {
                        job->fail(to_rpc_error(error));
                        return;
                      }
                      try {
                        job->start(world, engine_settings(*job, world->scene()), load_seconds + more_seconds);
                      } catch (...) {
                        job->fail(to_rpc_error(std::current_exception()));
                        return;
                      }
                      schedule(job);
                    });
  } catch (...) {
    job->fail(to_rpc_error(std::current_exception()));
  }
}

render::RenderSettings JobTable::engine_settings(const Job& job, const scene::Scene& scene) {
  render::RenderSettings engine = resolve_settings(job.settings(), scene, scheduler_.threads()).engine;
  engine.fill_only = job.fill_only();
  if (!job.settings().reference_sha256().empty())
    engine.reference =
        load_reference(job.settings().reference_sha256(), engine.film.crop, blobs_, scenes_.readers());
  if (job.uses_cache()) {
    const scene::FieldIdentity field = cache::record_field(scene, job.max_depth());
    const auto epoch = job.epoch();
    engine.integrator_settings.cache = epoch ? caches_.at_epoch(field, *epoch) : caches_.acquire(field);
  }
  return engine;
}

void JobTable::on_stopped(const std::shared_ptr<Job>& job) {
  scheduler_.remove(*job);
  const v1::Job description = job->describe();
  {
    const std::lock_guard lock(mutex_);
    if (active_.erase(job->id()) != 0) {
      active_film_bytes_ -= job->film_bytes();
      films_.give_back(job->film_bytes());
    }
    std::erase(waiting_, job);
    load_seconds_.erase(job->id());
    add(ended_, description.progress());
    if (description.state() == v1::JOB_STATE_FAILED) ++failures_[reason_of(description.error())];
  }
  films_freed_();
}

void JobTable::schedule(const std::shared_ptr<Job>& job) {
  scheduler_.add(job);
  // Should it have ended before it was added, its end found nothing to remove.
  if (!job->active()) scheduler_.remove(*job);
}

void JobTable::settle(const std::shared_ptr<Job>& job) {
  if (!job->active()) scheduler_.remove(*job);
  // It may have become active before it was removed.
  if (job->active()) schedule(job);
}

void JobTable::pause(const std::shared_ptr<Job>& job) {
  job->pause();
  // Else it would be owed the time that others have meanwhile.
  if (!job->active()) scheduler_.remove(*job);
}

void JobTable::unpause(const std::shared_ptr<Job>& job) {
  job->unpause();
  if (job->active()) schedule(job);
}

std::shared_ptr<Job> JobTable::find(const std::string& id) const {
  const std::lock_guard lock(mutex_);
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) {
    throw RpcError(StatusCode::NOT_FOUND, "JOB_NOT_FOUND", "there is no " + job_name(id),
                   {{"name", job_name(id)}});
  }
  return found->second;
}

v1::ListJobsResponse JobTable::list(const v1::ListJobsRequest& request) const {
  const int wanted = effective_page_size(request.page_size());
  if (!request.page_token().empty()) {
    try {
      parse_job_name(request.page_token());
    } catch (const RpcError&) {
      throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_PAGE_TOKEN",
                     "page_token is not one of this server's", {{"field", "page_token"}});
    }
  }
  std::vector<std::shared_ptr<Job>> older;  // oldest first
  {
    const std::lock_guard lock(mutex_);
    const auto end =
        request.page_token().empty() ? jobs_.end() : jobs_.lower_bound(parse_job_name(request.page_token()));
    for (auto it = jobs_.begin(); it != end; ++it) older.push_back(it->second);
  }
  v1::ListJobsResponse response;
  for (auto it = older.rbegin(); it != older.rend(); ++it) {
    if (request.states_size() != 0 &&
        std::ranges::find(request.states(), static_cast<int>((*it)->state())) == request.states().end()) {
      continue;
    }
    if (response.jobs_size() == wanted) {
      response.set_next_page_token(response.jobs(wanted - 1).name());
      break;
    }
    *response.add_jobs() = (*it)->describe();
  }
  return response;
}

size_t JobTable::unfinished() const {
  const std::lock_guard lock(mutex_);
  return waiting_.size() + active_.size() + creating_.size();
}

JobTable::Counts JobTable::counts() const {
  Counts counts;
  const std::lock_guard lock(mutex_);
  for (const auto& [id, job] : jobs_) {
    switch (job->state()) {
      case v1::JOB_STATE_QUEUED:
        ++counts.queued;
        break;
      case v1::JOB_STATE_RUNNING:
        ++counts.running;
        counts.rays_per_second += job->rays_per_second();
        break;
      case v1::JOB_STATE_SUCCEEDED:
        ++counts.succeeded;
        break;
      case v1::JOB_STATE_FAILED:
        ++counts.failed;
        break;
      case v1::JOB_STATE_PAUSED:
        ++counts.paused;
        break;
      default:
        ++counts.cancelled;
    }
  }
  return counts;
}

JobTable::Totals JobTable::totals() const {
  const std::lock_guard lock(mutex_);
  Totals totals = ended_;
  for (const auto& [id, job] : active_) add(totals, job->describe().progress());
  return totals;
}

int64_t JobTable::film_bytes() const {
  const std::lock_guard lock(mutex_);
  return active_film_bytes_;
}

void JobTable::watch_tasks() const {
  std::vector<std::shared_ptr<Job>> jobs;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [id, job] : active_) jobs.push_back(job);
  }
  const Clock::time_point now = Clock::now();
  for (const std::shared_ptr<Job>& job : jobs) job->watch_tasks(now);
}

std::map<std::string, uint64_t> JobTable::failures() const {
  const std::lock_guard lock(mutex_);
  return failures_;
}

}  // namespace fogbank::service
