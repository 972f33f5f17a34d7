// The replicas of leased jobs that this server performs tasks for.
#pragma once

#include <atomic>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "fogbank/v1/farm.pb.h"
#include "render/replica.h"
#include "service/scheduling/clock.h"

namespace fogbank::service {

/// A replica in use: whoever has it holds the pointer.
struct OpenedReplica {
  OpenedReplica(std::string id_to_use, std::shared_ptr<const transport::World> world,
                const render::RenderSettings& settings)
      : id(std::move(id_to_use)), replica(std::move(world), settings) {}

  const std::string id;
  render::Replica replica;
  std::atomic<bool> closed = false;  ///< what it performs is dropped
};

/// Thread-safe.
class ReplicaTable {
 public:
  /// `closed`: some replica was closed; called without any lock held.
  explicit ReplicaTable(std::function<void()> closed) : closed_(std::move(closed)) {}

  /// The replica that there is for the same scene, settings and log, or a new one. Throws RpcError
  /// INVALID_SETTINGS, TOO_MANY_REPLICAS, SHUTTING_DOWN, and as the engine.
  std::shared_ptr<OpenedReplica> open(const v1::OpenReplicaRequest& request,
                                      const std::shared_ptr<const transport::World>& world, int threads);
  /// Throws RpcError REPLICA_NOT_FOUND.
  std::shared_ptr<OpenedReplica> find(const std::string& id);
  void close(const std::string& id);
  /// Closes those that nobody has used for `replica_lifetime_seconds`.
  void sweep();
  void shut_down();

 private:
  struct Entry {
    std::shared_ptr<OpenedReplica> replica;
    Clock::time_point last_use;

    bool idle() const { return replica.use_count() == 1; }
  };

  /// Makes room for one more; with `mutex_` held. What is closed is to be released without it.
  std::shared_ptr<OpenedReplica> make_room();

  const std::function<void()> closed_;
  std::mutex mutex_;
  std::map<std::string, Entry> replicas_;
  bool shut_down_ = false;
};

}  // namespace fogbank::service
