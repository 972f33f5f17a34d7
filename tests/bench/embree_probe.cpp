// A library that is preloaded (LD_PRELOAD) and stands between the engine and Embree's two ray queries: how
// long do they take, and how long would the same rays take in a loop that does nothing else? So the engine
// itself carries no measuring code. With EMBREE_PROBE=replay each thread keeps its rays and traces them
// again, 4096 at a time (more than one pixel's paths, so that the caches don't hold the answers; few enough
// that the rays themselves stay in them).
#include "embree_probe.h"

#include <dlfcn.h>
#include <embree3/rtcore.h>
#include <x86intrin.h>

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <mutex>
#include <vector>

namespace fogbank {
namespace {

using Intersect = void(RTCScene, RTCIntersectContext*, RTCRayHit*);
using Occluded = void(RTCScene, RTCIntersectContext*, RTCRay*);

template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

Intersect* const real_intersect = next<Intersect>("rtcIntersect1");
Occluded* const real_occluded = next<Occluded>("rtcOccluded1");
const bool replay = [] {
  const char* mode = std::getenv("EMBREE_PROBE");
  return mode != nullptr && std::strcmp(mode, "replay") == 0;
}();
constexpr size_t batch = 4096;

struct Query {
  RTCScene scene;
  RTCRayHit ray;
  bool closest;
};

struct ThreadCounters {
  uint64_t rays = 0;
  uint64_t ticks = 0;
  uint64_t replayed_rays = 0;
  uint64_t replay_ticks = 0;
  std::vector<Query> queries;
};

std::mutex mutex;
std::vector<std::unique_ptr<ThreadCounters>> all_counters;

ThreadCounters& counters() {
  thread_local ThreadCounters* mine = [] {
    const std::lock_guard lock(mutex);
    return all_counters.emplace_back(std::make_unique<ThreadCounters>()).get();
  }();
  return *mine;
}

uint64_t clock_ticks() {
  _mm_lfence();
  return __rdtsc();
}

void replay_batch(ThreadCounters& mine) {
  const uint64_t begin = clock_ticks();
  for (Query& query : mine.queries) {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    if (query.closest) {
      real_intersect(query.scene, &context, &query.ray);
    } else {
      real_occluded(query.scene, &context, &query.ray.ray);
    }
  }
  mine.replay_ticks += clock_ticks() - begin;
  mine.replayed_rays += mine.queries.size();
  mine.queries.clear();
}

void keep(ThreadCounters& mine, RTCScene scene, const RTCRayHit& ray, bool closest) {
  mine.queries.push_back({scene, ray, closest});
  if (mine.queries.size() == batch) replay_batch(mine);
}

/// Ticks between two readings of the clock with nothing in between.
double ticks_of_clock() {
  constexpr int count = 10000;
  uint64_t ticks = 0;
  for (int i = 0; i < count; ++i) {
    const uint64_t begin = clock_ticks();
    ticks += clock_ticks() - begin;
  }
  return static_cast<double>(ticks) / count;
}

double seconds_per_tick() {
  static const double value = [] {
    const auto begin = std::chrono::steady_clock::now();
    const uint64_t begin_ticks = clock_ticks();
    while (std::chrono::steady_clock::now() - begin < std::chrono::milliseconds(50)) {
    }
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - begin;
    return elapsed.count() / static_cast<double>(clock_ticks() - begin_ticks);
  }();
  return value;
}

}  // namespace
}  // namespace fogbank

using namespace fogbank;

extern "C" {

void fogbank_embree_probe_take(EmbreeProbe* taken) {
  const std::lock_guard lock(mutex);
  EmbreeProbe& sum = *taken;
  sum = {};
  uint64_t ticks = 0;
  uint64_t replay_ticks = 0;
  for (const auto& thread : all_counters) {
    sum.rays += thread->rays;
    sum.replayed_rays += thread->replayed_rays;
    ticks += thread->ticks;
    replay_ticks += thread->replay_ticks;
    *thread = {};
  }
  sum.seconds =
      (static_cast<double>(ticks) - static_cast<double>(sum.rays) * ticks_of_clock()) * seconds_per_tick();
  sum.replay_seconds = static_cast<double>(replay_ticks) * seconds_per_tick();
}

void rtcIntersect1(RTCScene scene, RTCIntersectContext* context, RTCRayHit* ray) {
  ThreadCounters& mine = counters();
  if (replay) keep(mine, scene, *ray, true);
  const uint64_t begin = clock_ticks();
  real_intersect(scene, context, ray);
  mine.ticks += clock_ticks() - begin;
  ++mine.rays;
}

void rtcOccluded1(RTCScene scene, RTCIntersectContext* context, RTCRay* ray) {
  ThreadCounters& mine = counters();
  if (replay) {
    RTCRayHit whole{};
    whole.ray = *ray;
    keep(mine, scene, whole, false);
  }
  const uint64_t begin = clock_ticks();
  real_occluded(scene, context, ray);
  mine.ticks += clock_ticks() - begin;
  ++mine.rays;
}

}  // extern "C"
