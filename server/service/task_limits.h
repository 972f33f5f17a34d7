// How long a task of a job may run.
#pragma once

#include "service/limits.h"

namespace fogbank::service {

struct TaskLimits {
  double report_seconds = limits::default_task_report_seconds;  ///< is logged and counted then
  double limit_seconds = limits::default_task_limit_seconds;    ///< ends its job then
};

}  // namespace fogbank::service
