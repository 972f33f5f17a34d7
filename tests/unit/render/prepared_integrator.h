// An integrator with a preparation whose outcome is known: every round depends on the one before.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "function_integrator.h"

namespace fogbank::render {

/// What the tests want to know of a preparation, and to decide.
struct PreparationScript {
  uint32_t rounds = 3;
  uint32_t tasks = 5;
  /// Called by each task, with its number of the whole stage.
  std::function<void(uint32_t, RayCounters&)> in_task = [](uint32_t, RayCounters&) {};
  bool noisy_cache = false;     ///< the cached part is random
  double bias_per_error = 0.1;  ///< of a pixel, per CacheTarget::error

  // What happened:
  std::vector<integrators::CacheTarget> targets;
  std::atomic<int> running = 0;          ///< tasks of preparations
  std::atomic<int> sampling = 0;         ///< samples
  std::atomic<bool> overlapped = false;  ///< a round or a pass ran while it must not
  std::atomic<uint32_t> stages_done = 0;
  std::atomic<uint32_t> tasks_done = 0;
};

/// The sampled part is one random number. The cached part is the number that the preparation found: each
/// task of a round adds a number of its own to the sum of the round before, and publishes it at the end.
class PreparedIntegrator final : public integrators::Integrator {
 public:
  explicit PreparedIntegrator(PreparationScript& script) : script_(script) {}

  integrators::PixelSample sample(const Ray& ray, RandomStream& random, RayCounters&) const override {
    ++script_.sampling;
    if (script_.running > 0) script_.overlapped = true;
    integrators::PixelSample sample{.sampled = Spectrum(random.next_float()), .cached = Spectrum(published_)};
    sample.cached += 0.25f * glm::abs(ray.direction);
    if (script_.noisy_cache) sample.cached *= random.next_float();
    --script_.sampling;
    return sample;
  }

  std::unique_ptr<integrators::Preparation> prepare(const integrators::CameraRays&,
                                                    const integrators::CacheTarget& target) override {
    script_.targets.push_back(target);
    error_ = target.error;
    return std::make_unique<Rounds>(*this);
  }

  integrators::CacheCounts cache_counts() const override {
    return {.records_reused = 7, .records_new = script_.tasks_done, .epoch = script_.stages_done};
  }

  integrators::CacheView cache_view(const Ray&, RandomStream& random, RayCounters&) const override {
    return {.radius = random.next_float(),
            .record_density = 3,
            .rejected = 0,
            .variance = 0,
            .bias = static_cast<float>(script_.bias_per_error * error_)};
  }

 private:
  class Rounds final : public integrators::Preparation {
   public:
    explicit Rounds(PreparedIntegrator& owner) : owner_(owner) {}

    uint32_t next_round() override {
      PreparationScript& script = owner_.script_;
      if (script.running > 0 || script.sampling > 0) script.overlapped = true;
      for (const float value : values_) sum_ += value;
      values_.assign(script.tasks, 0.0f);
      if (round_++ < script.rounds) return script.tasks;
      owner_.published_ = sum_ / 100;
      ++script.stages_done;
      return 0;
    }
    void run(uint32_t task, RayCounters& counters) override {
      PreparationScript& script = owner_.script_;
      ++script.running;
      if (script.sampling > 0) script.overlapped = true;
      const Leave leave{script};
      script.in_task((round_ - 1) * script.tasks + task, counters);
      RandomStream random(0, task, round_, 0);
      values_[task] = random.next_float() + 0.1f * sum_;
      ++script.tasks_done;
    }
    double fraction() const override { return static_cast<double>(round_ - 1) / owner_.script_.rounds; }

   private:
    struct Leave {
      PreparationScript& script;
      ~Leave() { --script.running; }
    };

    PreparedIntegrator& owner_;
    uint32_t round_ = 0;
    float sum_ = 0;
    std::vector<float> values_;
  };

  PreparationScript& script_;
  float published_ = 0;
  double error_ = 0;
};

inline std::unique_ptr<PreparedIntegrator> prepared_integrator(PreparationScript& script) {
  return std::make_unique<PreparedIntegrator>(script);
}

}  // namespace fogbank::render
