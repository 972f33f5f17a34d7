#include "render/render_to_image.h"

#include <condition_variable>
#include <exception>
#include <thread>

namespace fogbank::render {

void run_to_completion(RenderJob& job, int threads) {
  const std::atomic<bool> never = false;
  std::mutex mutex;
  std::condition_variable task_ended;
  uint64_t tasks = 0;
  std::exception_ptr failure;

  const auto work = [&] {
    try {
      for (;;) {
        uint64_t tasks_seen = 0;
        {
          const std::lock_guard lock(mutex);
          tasks_seen = tasks;
        }
        if (const std::optional<Task> task = job.next_task()) {
          job.run(*task, never);
          const std::lock_guard lock(mutex);
          ++tasks;
          task_ended.notify_all();
          continue;
        }
        // The rest of the round or pass is with other threads, or the job has ended. The latter can happen
        // from outside, hence the limit to the wait.
        if (job.ended()) return;
        std::unique_lock lock(mutex);
        task_ended.wait_for(lock, std::chrono::milliseconds(20), [&] { return tasks != tasks_seen; });
      }
    } catch (...) {
      job.cancel();
      const std::lock_guard lock(mutex);
      if (!failure) failure = std::current_exception();
    }
  };

  {
    std::vector<std::jthread> crew;
    for (int i = 0; i < threads; ++i) crew.emplace_back(work);
  }
  if (failure) std::rethrow_exception(failure);
}

Image render_to_image(std::shared_ptr<const transport::World> world, const RenderSettings& settings,
                      int threads) {
  RenderJob job(std::move(world), settings);
  run_to_completion(job, threads);
  return job.image();
}

}  // namespace fogbank::render
