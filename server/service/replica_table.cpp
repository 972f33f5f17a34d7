#include "service/replica_table.h"

#include <utility>
#include <vector>

#include "core/sha256.h"
#include "service/job_settings.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"
#include "service/rpc_error.h"
#include "transport/world.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

constexpr size_t id_digits = 24;

/// The same for what is the same replica.
std::string id_of(const v1::OpenReplicaRequest& request) {
  return sha256(canonical_bytes(request)).substr(0, id_digits);
}

}  // namespace

std::shared_ptr<OpenedReplica> ReplicaTable::open(const v1::OpenReplicaRequest& request,
                                                  const std::shared_ptr<const transport::World>& world,
                                                  int threads) {
  const std::string id = id_of(request);
  std::shared_ptr<OpenedReplica> pushed_out;
  {
    const std::lock_guard lock(mutex_);
    if (shut_down_) throw shutting_down();
    if (const auto found = replicas_.find(id); found != replicas_.end()) {
      found->second.last_use = Clock::now();
      return found->second.replica;
    }
    pushed_out = make_room();
  }
  if (pushed_out) closed_();
  // What it compares with, and how many threads the coordinator has, are no affair of a replica's.
  v1::RenderSettings settings = request.settings();
  settings.clear_reference_sha256();
  settings.clear_max_threads();
  auto opened =
      std::make_shared<OpenedReplica>(id, world, resolve_settings(settings, world->scene(), threads).engine);
  const std::lock_guard lock(mutex_);
  if (shut_down_) throw shutting_down();
  return replicas_.try_emplace(id, Entry{std::move(opened), Clock::now()}).first->second.replica;
}

std::shared_ptr<OpenedReplica> ReplicaTable::make_room() {
  if (replicas_.size() < static_cast<size_t>(limits::max_replicas)) return nullptr;
  auto oldest = replicas_.end();
  for (auto it = replicas_.begin(); it != replicas_.end(); ++it) {
    if (it->second.idle() && (oldest == replicas_.end() || it->second.last_use < oldest->second.last_use))
      oldest = it;
  }
  if (oldest == replicas_.end()) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_REPLICAS",
                   "as many replicas as the server takes are at work", {{"limit", "max_replicas"}});
  }
  std::shared_ptr<OpenedReplica> replica = std::move(oldest->second.replica);
  replicas_.erase(oldest);
  replica->closed = true;
  return replica;
}

std::shared_ptr<OpenedReplica> ReplicaTable::find(const std::string& id) {
  const std::lock_guard lock(mutex_);
  if (shut_down_) throw shutting_down();
  const auto found = replicas_.find(id);
  if (found == replicas_.end()) {
    throw RpcError(StatusCode::NOT_FOUND, "REPLICA_NOT_FOUND",
                   "there is no " + replica_name(id) + "; open it again", {{"name", replica_name(id)}});
  }
  found->second.last_use = Clock::now();
  return found->second.replica;
}

void ReplicaTable::close(const std::string& id) {
  std::shared_ptr<OpenedReplica> replica;
  {
    const std::lock_guard lock(mutex_);
    if (auto node = replicas_.extract(id)) replica = std::move(node.mapped().replica);
  }
  if (!replica) return;
  replica->closed = true;
  closed_();
}

void ReplicaTable::sweep() {
  const Clock::time_point limit = Clock::now() - seconds(limits::replica_lifetime_seconds);
  std::vector<std::shared_ptr<OpenedReplica>> unused;
  const std::lock_guard lock(mutex_);
  for (auto it = replicas_.begin(); it != replicas_.end();) {
    if (it->second.idle() && it->second.last_use < limit) {
      unused.push_back(std::move(it->second.replica));
      it = replicas_.erase(it);
    } else {
      ++it;
    }
  }
}

void ReplicaTable::shut_down() {
  std::map<std::string, Entry> all;
  {
    const std::lock_guard lock(mutex_);
    shut_down_ = true;
    all.swap(replicas_);
  }
  for (const auto& [id, entry] : all) entry.replica->closed = true;
  closed_();
}

}  // namespace fogbank::service
