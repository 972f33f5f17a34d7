// What it saves that a record leaves out the terms its scene doesn't need (transport/plan.h).
#include <benchmark/benchmark.h>

#include <memory>
#include <string>

#include "derivatives/estimator.h"
#include "scene/loader.h"

namespace {

using namespace fogbank;
using namespace fogbank::derivatives;

struct Case {
  const char* name;
  const char* folder;
  const char* file;
  Vec3f x;
  Order order;
  int32_t max_depth;
};

/// Records of the project's scenes, and of one where nothing is in the light's way and nothing reflects.
const Case cases[] = {
    {"open_light", "scenes/analytic", "area_single.xml", Vec3f(0, 0, 0), Order::single, -1},
    {"point_light", "scenes/analytic", "point_single.xml", Vec3f(0.1f, 0.2f, 0.3f), Order::single, -1},
    {"penumbra_direct", "scenes/penumbra", "penumbra.xml", Vec3f(0.3f, 0.1f, 0.2f), Order::single, 2},
    {"penumbra_surfaces", "scenes/penumbra", "penumbra.xml", Vec3f(0.3f, 0.1f, 0.2f), Order::single, 8},
    {"penumbra_everything", "scenes/penumbra", "penumbra.xml", Vec3f(0.3f, 0.1f, 0.2f), Order::both, 8},
};

void record(benchmark::State& state, const Case& scene, bool leave_out) {
  scene::prepare_render_thread();
  const auto world = std::make_shared<const transport::World>(
      scene::load_scene(scene.file, scene::folder_source(scene.folder), {}));
  EstimatorSettings settings;
  settings.order = scene.order;
  settings.max_depth = scene.max_depth;
  settings.leave_out = leave_out;
  const auto estimator = make_estimator("aware", world, settings);
  uint32_t repeat = 0;
  RayCounters counters;
  for (auto _ : state) benchmark::DoNotOptimize(estimator->estimate(scene.x, repeat++, counters));
  state.counters["rays"] = static_cast<double>(counters.total()) / repeat;
}

}  // namespace

int main(int argc, char** argv) {
  for (const Case& scene : cases)
    for (const bool leave_out : {true, false})
      benchmark::RegisterBenchmark(
          (std::string(scene.name) + (leave_out ? "/planned" : "/everything")).c_str(),
          [&scene, leave_out](benchmark::State& state) { record(state, scene, leave_out); })
          ->Unit(benchmark::kMicrosecond);
  benchmark::Initialize(&argc, argv);
  benchmark::RunSpecifiedBenchmarks();
}
