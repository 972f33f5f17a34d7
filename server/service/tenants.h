// The users of the server: who calls, and what is theirs.
#pragma once

#include <grpcpp/grpcpp.h>

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include "service/answers.h"
#include "service/audit_log.h"
#include "service/tenant.h"
#include "service/token_file.h"

namespace fogbank::service {

/// Every rpc enters through here. Without authentication there is one tenant, whose folder is the data
/// directory itself; with it each has a folder below `tenants`. Tenants come with their first call or, those
/// that have a folder, with `open_known`, and stay. Thread-safe.
class Tenants {
 public:
  struct Settings {
    std::filesystem::path data;
    bool authentication = false;
    int64_t memory_bytes = 0;  ///< for scenes and caches, shared out evenly
    TenantSettings tenant;
  };

  /// `traces` null: nothing is traced.
  Tenants(Settings settings, TaskQueue& control, TaskQueue& writer, TaskQueue& loader, ReaderHost& readers,
          Scheduler& scheduler, FilmBudget& films, TraceLog* traces);

  /// Opens the tenants of earlier lives, and goes on with their jobs.
  void open_known();

  /// The caller's tenant. `rpc` is "Service.Method". Throws RpcError UNAUTHENTICATED (TOKEN_MISSING,
  /// TOKEN_INVALID, TOKEN_EXPIRED, TOKEN_REVOKED) or PERMISSION_DENIED (SCOPE_MISSING).
  Tenant& enter(const grpc::CallbackServerContext& context, std::string_view rpc);

  std::vector<Tenant*> all() const;

 private:
  Identity identify(const grpc::CallbackServerContext& context);
  Tenant& open(const std::string& name);

  const Settings settings_;
  QuotaFile quotas_;
  SharedServices shared_;
  TokenFile tokens_;
  std::unique_ptr<AuditLog> audit_;  ///< with authentication only
  std::mutex opening_;               ///< before `mutex_`
  mutable std::mutex mutex_;
  std::map<std::string, std::unique_ptr<Tenant>> tenants_;  ///< by name
};

/// A stream or call that is refused at once.
template <typename Reactor>
class RefusedReactor final : public Reactor {
 public:
  explicit RefusedReactor(const grpc::Status& status) { this->Finish(status); }
  void OnDone() override { delete this; }
};

/// What `start` makes for the caller's tenant, or a reactor that refuses.
template <typename Reactor, typename Start>
Reactor* start_in_tenant(Tenants& tenants, const grpc::CallbackServerContext& context, std::string_view rpc,
                         Start start) {
  try {
    return start(tenants.enter(context, rpc));
  } catch (...) {
    return new RefusedReactor<Reactor>(status_of(std::current_exception()));
  }
}

}  // namespace fogbank::service
