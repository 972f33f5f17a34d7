#include "service/job_trace.h"

#include <utility>

namespace fogbank::service {

JobTrace::JobTrace(TraceLog* log, std::optional<TraceContext> client, std::string job)
    : log_(client && !client->sampled ? nullptr : log),
      parent_(client            ? std::move(*client)
              : log_ != nullptr ? new_trace()
                                : TraceContext{}),
      job_(std::move(job)),
      id_(log_ == nullptr ? "" : new_span_id()),
      begin_(std::chrono::system_clock::now()) {}

std::optional<TraceContext> JobTrace::context() const {
  if (log_ == nullptr) return {};
  return TraceContext{.trace_id = parent_.trace_id, .span_id = id_, .sampled = true};
}

void JobTrace::begin(const std::string& part) {
  if (log_ != nullptr && !finished_) parts_.emplace(part, std::chrono::system_clock::now());
}

void JobTrace::end(const std::string& part, std::map<std::string, Span::Value> attributes) {
  const auto begun = parts_.extract(part);
  if (!begun) return;
  attributes["fogbank.job"] = job_;
  log_->write({.parent = *context(),
               .id = new_span_id(),
               .name = part,
               .begin = begun.mapped(),
               .end = std::chrono::system_clock::now(),
               .attributes = std::move(attributes)});
}

void JobTrace::add(const std::string& part, double seconds) {
  if (log_ == nullptr || finished_ || seconds <= 0) return;
  const auto length =
      std::chrono::duration_cast<Span::Time::duration>(std::chrono::duration<double>(seconds));
  parts_.emplace(part, std::chrono::system_clock::now() - length);
  end(part);
}

void JobTrace::finish(const std::string& state, bool failed) {
  if (log_ == nullptr || finished_) return;
  while (!parts_.empty()) end(parts_.begin()->first);
  finished_ = true;
  log_->write({.parent = parent_,
               .id = id_,
               .name = "job",
               .begin = begin_,
               .end = std::chrono::system_clock::now(),
               .attributes = {{"fogbank.job", job_}, {"fogbank.state", state}},
               .failed = failed});
}

}  // namespace fogbank::service
