#include "service/fill_workload.h"

namespace fogbank::service {

void FillWorkload::start() { scheduler_.add(shared_from_this()); }

void FillWorkload::cancel() {
  job_->cancel();
  scheduler_.remove(*this);
}

std::function<void()> FillWorkload::take() {
  if (!job_->has_work()) return {};
  return [self = shared_from_this()] { self->run(); };
}

void FillWorkload::run() {
  job_->work();
  if (job_->progress().ended) {
    std::call_once(end_told_, [this] {
      scheduler_.remove(*this);
      ended_();
    });
  } else {
    scheduler_.wake();
  }
}

}  // namespace fogbank::service
