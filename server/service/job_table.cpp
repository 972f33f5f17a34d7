#include "service/job_table.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "core/sha256.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"
#include "service/reference_image.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

RpcError shutting_down() { return {StatusCode::UNAVAILABLE, "SHUTTING_DOWN", "the server is shutting down"}; }

}  // namespace

JobTable::JobTable(Settings settings, SceneRegistry& scenes, CacheRegistry& caches, BlobStore& blobs,
                   Scheduler& scheduler, TaskQueue& writer, std::function<void()> changed)
    : settings_(std::move(settings)),
      scenes_(scenes),
      caches_(caches),
      blobs_(blobs),
      scheduler_(scheduler),
      services_{.writer = writer,
                .changed = std::move(changed),
                .ended = [this](const std::shared_ptr<Job>& job) { on_ended(job); }} {
  fs::create_directories(settings_.folder);
  restore();
}

void JobTable::restore() {
  for (const auto& folder : fs::directory_iterator(settings_.folder)) {
    try {
      const std::shared_ptr<Job> job = Job::restore(folder.path(), services_);
      id_by_request_[job->request_id()] = job->id();
      jobs_.emplace(job->id(), job);
    } catch (const std::exception& error) {
      spdlog::warn("job folder {} is passed over: {}", folder.path().filename().string(), error.what());
    }
  }
}

void JobTable::create(const v1::CreateJobRequest& request, Created done) {
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
  if (waiting_.size() + active_.size() + creating_.size() >= static_cast<size_t>(limits::max_queued_jobs)) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_JOBS",
                   "there are as many unfinished jobs as the server takes; retry when some have ended",
                   {{"limit", "max_queued_jobs"}});
  }
  Creation creation{.request_hash = hash, .waiting = {}};
  creation.waiting.push_back(std::move(done));
  creating_.emplace(request.request_id(), std::move(creation));
  lock.unlock();
  try {
    scenes_.acquire(scene_id, [this, request](const std::shared_ptr<const transport::World>& world,
                                              double load_seconds, std::exception_ptr error) {
      finish_creation(request, world, load_seconds, std::move(error));
    });
  } catch (...) {
    finish_creation(request, nullptr, 0, std::current_exception());
  }
}

std::shared_ptr<Job> JobTable::make_job(const v1::CreateJobRequest& request, const scene::Scene& scene) {
  JobSettings settings = resolve_settings(request.settings(), scene, scheduler_.threads());
  if (!settings.effective.reference_sha256().empty()) {
    settings.engine.reference =
        load_reference(settings.effective.reference_sha256(), settings.engine.film.crop, blobs_);
  }
  if (settings.effective.has_epoch()) {
    caches_.at_epoch(cache::record_field(scene, settings.effective.max_depth()), settings.effective.epoch());
  }
  const std::string id = new_job_id();
  auto job = std::make_shared<Job>(id, request, std::move(settings), settings_.folder / id, services_);
  if (job->film_bytes() > settings_.film_budget_bytes) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "IMAGE_TOO_LARGE",
                   "the film needs " + std::to_string(job->film_bytes()) +
                       " bytes of memory; this server has " + std::to_string(settings_.film_budget_bytes) +
                       " for films",
                   {{"field", "settings.crop"}});
  }
  try {
    job->save(request);
  } catch (...) {
    std::error_code ignored;
    fs::remove_all(job->folder(), ignored);
    throw;
  }
  return job;
}

void JobTable::finish_creation(const v1::CreateJobRequest& request,
                               const std::shared_ptr<const transport::World>& world, double load_seconds,
                               std::exception_ptr error) {
  std::shared_ptr<Job> job;
  if (!error) {
    try {
      job = make_job(request, world->scene());
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
  if (stopped) job->cancel(shutting_down());
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
        if (active_film_bytes_ + job->film_bytes() > settings_.film_budget_bytes) break;
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
                        job->start(world, cache_of(*job, world->scene()), load_seconds + more_seconds);
                      } catch (...) {
                        job->fail(to_rpc_error(std::current_exception()));
                        return;
                      }
                      scheduler_.add(job);
                      // Should it have ended before it was added, its end found nothing to remove.
                      if (job->ended()) scheduler_.remove(*job);
                    });
  } catch (...) {
    job->fail(to_rpc_error(std::current_exception()));
  }
}

std::shared_ptr<cache::SceneCache> JobTable::cache_of(const Job& job, const scene::Scene& scene) {
  if (!job.uses_cache()) return nullptr;
  const scene::FieldIdentity field = cache::record_field(scene, job.max_depth());
  if (const auto epoch = job.epoch()) return caches_.at_epoch(field, *epoch);
  return caches_.acquire(field);
}

void JobTable::on_ended(const std::shared_ptr<Job>& job) {
  scheduler_.remove(*job);
  {
    const std::lock_guard lock(mutex_);
    if (active_.erase(job->id()) != 0) active_film_bytes_ -= job->film_bytes();
    std::erase(waiting_, job);
    load_seconds_.erase(job->id());
    ended_rays_ += job->describe().progress().rays();
  }
  admit();
}

void JobTable::forget_old() {
  std::vector<std::shared_ptr<Job>> forgotten;
  {
    const std::lock_guard lock(mutex_);
    const size_t unfinished = waiting_.size() + active_.size();
    const auto limit = static_cast<size_t>(limits::max_kept_jobs);
    for (auto it = jobs_.begin(); it != jobs_.end() && jobs_.size() - unfinished > limit;) {
      if (!it->second->ended()) {
        ++it;
        continue;
      }
      id_by_request_.erase(it->second->request_id());
      forgotten.push_back(std::move(it->second));
      it = jobs_.erase(it);
    }
  }
  for (const std::shared_ptr<Job>& job : forgotten) {
    std::error_code ignored;
    fs::remove(job->folder() / "job.json", ignored);  // first: without it the folder counts as absent
    fs::remove_all(job->folder(), ignored);
  }
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

void JobTable::shut_down() {
  std::vector<std::shared_ptr<Job>> jobs;
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    jobs.assign(waiting_.begin(), waiting_.end());
    for (const auto& [id, job] : active_) jobs.push_back(job);
  }
  for (const std::shared_ptr<Job>& job : jobs) job->cancel(shutting_down());
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
      default:
        ++counts.cancelled;
    }
  }
  return counts;
}

uint64_t JobTable::rays() const {
  const std::lock_guard lock(mutex_);
  uint64_t rays = ended_rays_;
  for (const auto& [id, job] : active_) rays += job->describe().progress().rays();
  return rays;
}

}  // namespace fogbank::service
