// How reactions answer: they post and return, the work is done elsewhere.
#pragma once

#include <grpcpp/grpcpp.h>

#include <exception>
#include <utility>

#include "service/rpc_error.h"
#include "service/scheduling/task_queue.h"

namespace fogbank::service {

inline grpc::Status shutting_down_status() { return to_grpc_status(shutting_down()); }

inline grpc::Status status_of(const std::exception_ptr& exception) {
  return to_grpc_status(to_rpc_error(exception));
}

/// Runs `work` in the queue and finishes the rpc with OK, or with what it throws.
template <typename Work>
grpc::ServerUnaryReactor* answer(grpc::CallbackServerContext* context, TaskQueue& queue, Work work) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const bool posted = queue.post([reactor, work = std::move(work)] {
    grpc::Status status;
    try {
      work();
    } catch (...) {
      status = status_of(std::current_exception());
    }
    reactor->Finish(status);
  });
  if (!posted) reactor->Finish(shutting_down_status());
  return reactor;
}

/// As `answer`, for work that ends later: `work(reactor)` sees to it that the reactor is finished, unless it
/// throws.
template <typename Work>
grpc::ServerUnaryReactor* answer_later(grpc::CallbackServerContext* context, TaskQueue& queue, Work work) {
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  const bool posted = queue.post([reactor, work = std::move(work)] {
    try {
      work(reactor);
    } catch (...) {
      reactor->Finish(status_of(std::current_exception()));
    }
  });
  if (!posted) reactor->Finish(shutting_down_status());
  return reactor;
}

}  // namespace fogbank::service
