#include "service/farm_service.h"

#include <utility>

#include "core/sha256.h"
#include "service/answers.h"
#include "service/build_id.h"
#include "service/complete_stream.h"
#include "service/lease_call.h"
#include "service/leased_messages.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/perform_stream.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

constexpr size_t most_log_name = 128;

void check_open(const v1::OpenReplicaRequest& request) {
  if (request.build_id() != build_id()) {
    throw RpcError(StatusCode::FAILED_PRECONDITION, "BUILD_MISMATCH",
                   "the coordinator is another build of fogbankd, and its pixels would differ",
                   {{"build_id", build_id()}});
  }
  if (request.log().empty() || request.log().size() > most_log_name)
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_REPLICA", "log: must be a log's id",
                   {{"field", "log"}});
}

/// Replays entries on a render thread: with the rounds of a preparation indices are built. Lives until gRPC
/// and the scheduler have let go of it.
class AdvanceCall final : public grpc::ServerUnaryReactor,
                          public Workload,
                          public std::enable_shared_from_this<AdvanceCall> {
 public:
  AdvanceCall(const v1::AdvanceReplicaRequest& request, v1::AdvanceReplicaResponse& response,
              Scheduler& scheduler)
      : request_(request), response_(response), scheduler_(scheduler) {}

  void start(Tenants& tenants, const grpc::CallbackServerContext& context, TaskQueue& control) {
    self_ = shared_from_this();
    const bool posted = control.post([self = shared_from_this(), &tenants, &context] {
      try {
        self->tenant_ = &tenants.enter(context, "FarmService.AdvanceReplica");
        self->group_ = self->tenant_->performs.group;
        self->replica_ = self->tenant_->replicas.find(parse_replica_name(self->request_.replica()));
        self->scheduler_.add(self);
      } catch (...) {
        self->Finish(status_of(std::current_exception()));
      }
    });
    if (!posted) Finish(shutting_down_status());
  }

  std::function<void()> take() override {
    if (std::exchange(taken_, true)) return {};
    return [self = shared_from_this()] { self->run(); };
  }
  int group() const override { return group_; }

  void OnDone() override { self_.reset(); }

 private:
  void run() {
    scheduler_.remove(*this);
    grpc::Status status;
    try {
      replay();
    } catch (...) {
      const RpcError error = to_rpc_error(std::current_exception());
      status = to_grpc_status(with_log_length(error, replica_->replica.log_length()));
      // Whatever else is wrong, it can't follow the job any more.
      if (error.reason() != "REPLICA_BEHIND") tenant_->replicas.close(replica_->id);
    }
    response_.set_log_length(replica_->replica.log_length());
    replica_ = nullptr;
    Finish(status);
  }

  void replay() {
    for (const v1::JobLogEntry& entry : request_.entries()) {
      if (entry.index() < replica_->replica.log_length()) continue;
      if (sha256(entry.data()) != entry.sha256())
        throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_LOG", "an entry is not what its hash says");
      replica_->replica.advance(entry.index(), entry.data());
    }
  }

  const v1::AdvanceReplicaRequest& request_;
  v1::AdvanceReplicaResponse& response_;
  Scheduler& scheduler_;
  std::shared_ptr<AdvanceCall> self_;  ///< until OnDone
  Tenant* tenant_ = nullptr;
  int group_ = 0;
  std::shared_ptr<OpenedReplica> replica_;
  bool taken_ = false;  ///< with the scheduler's lock held
};

}  // namespace

grpc::ServerUnaryReactor* FarmServiceImplementation::LeaseTasks(grpc::CallbackServerContext* context,
                                                                const v1::LeaseTasksRequest* request,
                                                                v1::LeaseTasksResponse* response) {
  return start_lease(*context, *request, *response, tenants_, control_);
}

grpc::ServerReadReactor<v1::CompleteTasksRequest>* FarmServiceImplementation::CompleteTasks(
    grpc::CallbackServerContext* context, v1::CompleteTasksResponse* response) {
  using Reactor = grpc::ServerReadReactor<v1::CompleteTasksRequest>;
  return start_in_tenant<Reactor>(tenants_, *context, "FarmService.CompleteTasks", [&](Tenant& tenant) {
    return start_completion(*response, tenant.jobs, files_);
  });
}

grpc::ServerUnaryReactor* FarmServiceImplementation::ReadJobLog(grpc::CallbackServerContext* context,
                                                                const v1::ReadJobLogRequest* request,
                                                                v1::ReadJobLogResponse* response) {
  return answer(context, control_, [this, context, request, response] {
    const JobTable& jobs = tenants_.enter(*context, "FarmService.ReadJobLog").jobs;
    jobs.find(parse_job_name(request->job()))->read_log(request->log(), request->first(), *response);
  });
}

grpc::ServerUnaryReactor* FarmServiceImplementation::OpenReplica(grpc::CallbackServerContext* context,
                                                                 const v1::OpenReplicaRequest* request,
                                                                 v1::OpenReplicaResponse* response) {
  return answer_later(
      context, control_, [this, context, request, response](grpc::ServerUnaryReactor* reactor) {
        Tenant& tenant = tenants_.enter(*context, "FarmService.OpenReplica");
        check_open(*request);
        const auto open = [this, &tenant, request, response,
                           reactor](const std::shared_ptr<const transport::World>& world) {
          grpc::Status status;
          try {
            const auto opened = tenant.replicas.open(*request, world, scheduler_.threads());
            response->set_replica(replica_name(opened->id));
            response->set_log_length(opened->replica.log_length());
          } catch (...) {
            status = status_of(std::current_exception());
          }
          reactor->Finish(status);
        };
        tenant.scenes.acquire(parse_scene_name(request->scene()),
                              [this, open, reactor](const std::shared_ptr<const transport::World>& world,
                                                    double, const std::exception_ptr& error) {
                                if (error) {
                                  reactor->Finish(status_of(error));
                                  return;
                                }
                                // Not in the loader's thread, for which scenes may wait.
                                if (!files_.post([open, world] { open(world); }))
                                  reactor->Finish(shutting_down_status());
                              });
      });
}

grpc::ServerUnaryReactor* FarmServiceImplementation::AdvanceReplica(grpc::CallbackServerContext* context,
                                                                    const v1::AdvanceReplicaRequest* request,
                                                                    v1::AdvanceReplicaResponse* response) {
  const auto call = std::make_shared<AdvanceCall>(*request, *response, scheduler_);
  call->start(tenants_, *context, control_);
  return call.get();
}

grpc::ServerWriteReactor<v1::PerformTasksResponse>* FarmServiceImplementation::PerformTasks(
    grpc::CallbackServerContext* context, const v1::PerformTasksRequest* request) {
  using Reactor = grpc::ServerWriteReactor<v1::PerformTasksResponse>;
  return start_in_tenant<Reactor>(tenants_, *context, "FarmService.PerformTasks", [&](Tenant& tenant) {
    return start_performing(*context, *request, tenant.replicas, tenant.performs);
  });
}

grpc::ServerUnaryReactor* FarmServiceImplementation::CloseReplica(grpc::CallbackServerContext* context,
                                                                  const v1::CloseReplicaRequest* request,
                                                                  v1::CloseReplicaResponse*) {
  return answer(context, control_, [this, context, request] {
    Tenant& tenant = tenants_.enter(*context, "FarmService.CloseReplica");
    tenant.replicas.close(parse_replica_name(request->replica()));
  });
}

}  // namespace fogbank::service
