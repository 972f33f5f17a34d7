#include "service/work_trace.h"

#include <utility>

namespace fogbank::service {

std::optional<TraceContext> client_trace(const grpc::CallbackServerContext& context) {
  const auto header = context.client_metadata().find("traceparent");
  if (header == context.client_metadata().end()) return {};
  return parse_traceparent({header->second.data(), header->second.size()});
}

WorkTrace::WorkTrace(TraceLog* log, std::optional<TraceContext> client, std::string name, Attributes subject)
    : log_(client && !client->sampled ? nullptr : log),
      parent_(client            ? std::move(*client)
              : log_ != nullptr ? new_trace()
                                : TraceContext{}),
      name_(std::move(name)),
      subject_(std::move(subject)),
      id_(log_ == nullptr ? "" : new_span_id()),
      begin_(std::chrono::system_clock::now()) {}

std::optional<TraceContext> WorkTrace::context() const {
  if (log_ == nullptr) return {};
  return TraceContext{.trace_id = parent_.trace_id, .span_id = id_, .sampled = true};
}

void WorkTrace::begin(const std::string& part) {
  if (log_ != nullptr && !finished_) parts_.emplace(part, std::chrono::system_clock::now());
}

void WorkTrace::end(const std::string& part, Attributes attributes) {
  const auto begun = parts_.extract(part);
  if (!begun) return;
  attributes.insert(subject_.begin(), subject_.end());
  log_->write({.parent = *context(),
               .id = new_span_id(),
               .name = part,
               .begin = begun.mapped(),
               .end = std::chrono::system_clock::now(),
               .attributes = std::move(attributes)});
}

void WorkTrace::add(const std::string& part, double seconds) {
  if (log_ == nullptr || finished_ || seconds <= 0) return;
  const auto length =
      std::chrono::duration_cast<Span::Time::duration>(std::chrono::duration<double>(seconds));
  parts_.emplace(part, std::chrono::system_clock::now() - length);
  end(part);
}

void WorkTrace::finish(Attributes attributes, bool failed) {
  if (log_ == nullptr || finished_) return;
  while (!parts_.empty()) end(parts_.begin()->first);
  finished_ = true;
  attributes.insert(subject_.begin(), subject_.end());
  log_->write({.parent = parent_,
               .id = id_,
               .name = name_,
               .begin = begin_,
               .end = std::chrono::system_clock::now(),
               .attributes = std::move(attributes),
               .failed = failed});
}

}  // namespace fogbank::service
