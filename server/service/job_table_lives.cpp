// The part of JobTable that brings jobs from one life of the server into the next, and forgets old ones.
#include <spdlog/spdlog.h>

#include <utility>

#include "core/failpoint.h"
#include "service/job_table.h"
#include "service/limits.h"
#include "service/names.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

void JobTable::restore() {
  std::vector<StoredJob> changed;
  for (StoredJob& row : store_.load()) {
    try {
      const bool had_ended = has_ended(row.description.state());
      const auto job = std::make_shared<Job>(std::move(row), services_);
      id_by_request_[job->request_id()] = job->id();
      jobs_.emplace(job->id(), job);
      if (!had_ended) changed.push_back(job->stored());
      if (!job->ended()) waiting_.push_back(job);
    } catch (const std::exception& error) {
      spdlog::error("a job of an earlier life is passed over: {}", error.what());
    }
  }
  // In one transaction, before anybody can be told a revision of this life.
  FOGBANK_FAILPOINT("job.before_restore");
  store_.put(changed);
  FOGBANK_FAILPOINT("job.after_restore");
  if (store_.complete()) remove_orphans();
}

void JobTable::remove_orphans() const {
  for (const auto& file : fs::directory_iterator(settings_.folder)) {
    const fs::path& path = file.path();
    const bool ours = path.extension() == ".exr" || path.extension() == ".checkpoint";
    const auto job = jobs_.find(path.stem());
    const bool wanted = ours && job != jobs_.end() && (path.extension() == ".exr" || !job->second->ended());
    std::error_code ignored;
    if ((ours && !wanted) || path.extension() == ".tmp") fs::remove(path, ignored);
  }
}

void JobTable::resume() {
  std::deque<std::shared_ptr<Job>> jobs;
  {
    const std::lock_guard lock(mutex_);
    jobs = waiting_;
  }
  const RpcError why(StatusCode::ABORTED, "SERVER_RESTARTED",
                     "the server, which a client had started for itself, ended before the job");
  for (const std::shared_ptr<Job>& job : jobs) {
    if (!settings_.jobs_outlive_server) {
      job->abandon(why);
    } else if (job->film_bytes() > films_.total()) {
      job->fail(too_large(*job));
    }
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
  std::vector<std::string> names;
  for (const std::shared_ptr<Job>& job : forgotten) names.push_back(job_name(job->id()));
  try {
    store_.remove(names);
  } catch (const std::exception& error) {
    spdlog::warn("old jobs come back with the next start: {}", error.what());
    return;
  }
  for (const std::shared_ptr<Job>& job : forgotten) {
    std::error_code ignored;
    fs::remove(job->image_path(), ignored);
  }
}

void JobTable::shut_down() {
  std::vector<std::shared_ptr<Job>> jobs;
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    jobs.assign(waiting_.begin(), waiting_.end());
    for (const auto& [id, job] : active_) jobs.push_back(job);
  }
  for (const std::shared_ptr<Job>& job : jobs) stop(*job);
}

void JobTable::stop(Job& job) const {
  if (settings_.jobs_outlive_server) {
    job.suspend();
  } else {
    job.abandon(shutting_down());
  }
}

std::set<std::string> JobTable::blobs_in_use() const {
  std::set<std::string> blobs;
  const std::lock_guard lock(mutex_);
  const auto add = [&](const Job& job) {
    if (const std::string& sha256 = job.settings().reference_sha256(); !sha256.empty()) blobs.insert(sha256);
  };
  for (const std::shared_ptr<Job>& job : waiting_) add(*job);
  for (const auto& [id, job] : active_) add(*job);
  return blobs;
}

}  // namespace fogbank::service
