#include "service/probe_workload.h"

#include <utility>

#include "service/limits.h"

namespace fogbank::service {

void ProbeWorkload::add(std::vector<Vec3f> points) {
  job_->add(std::move(points));
  update();
}

void ProbeWorkload::cancel() {
  job_->cancel();
  update();
}

std::function<void()> ProbeWorkload::take() {
  if (!job_->has_work()) return {};
  return [self = shared_from_this()] { self->run(); };
}

void ProbeWorkload::run() {
  const bool changed = job_->work(seconds(limits::probe_slice_seconds));
  update();
  if (changed) changed_();
}

void ProbeWorkload::update() {
  const std::lock_guard lock(mutex_);
  const bool wanted = job_->has_work();
  if (wanted && !scheduled_) {
    scheduler_.add(shared_from_this());
  } else if (wanted) {
    scheduler_.wake();
  } else if (scheduled_) {
    scheduler_.remove(*this);
  }
  scheduled_ = wanted;
}

}  // namespace fogbank::service
