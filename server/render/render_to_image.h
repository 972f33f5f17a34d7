// A whole rendering in one call, for tests and benchmarks; the service drives a RenderJob with its own
// threads.
#pragma once

#include <memory>

#include "render/render_job.h"

namespace fogbank::render {

/// Runs all tasks of `job` on `threads` (>= 1) new threads and returns when it is finished or cancelled.
/// Rethrows the first exception of a task, after cancelling the job.
void run_to_completion(RenderJob& job, int threads);

/// Image of `world` with `settings`. Throws like RenderJob's constructor and `run_to_completion`.
Image render_to_image(std::shared_ptr<const transport::World> world, const RenderSettings& settings,
                      int threads);

}  // namespace fogbank::render
