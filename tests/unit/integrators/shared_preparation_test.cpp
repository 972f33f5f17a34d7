// Several processes that go through one preparation together, as two integrators with caches of their own:
// bytes are all that goes between them.
#include <gtest/gtest.h>

#include <random>

#include "cache/record_bytes.h"
#include "cache/scene_cache.h"
#include "core/error.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using test::TestCamera;

std::shared_ptr<const transport::World> foggy_room(const std::string& sigma_t, const std::string& albedo,
                                                   const std::string& g = "0") {
  return transport::test::parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" +
                                      sigma_t + R"("/><rgb name="albedo" value=")" + albedo +
                                      R"("/><phase type="hg"><float name="g" value=")" + g +
                                      R"("/></phase></medium>
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <ref name="medium" id="fog"/>
  </sensor>
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
  <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="wall"/></shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate x="0" y="0" z="0.99"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
  </shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform><ref id="wall"/></shape>)");
}

/// An integrator with a cache of its own.
struct Process {
  std::shared_ptr<cache::SceneCache> cache = std::make_shared<cache::SceneCache>();
  std::unique_ptr<Integrator> integrator;
  std::unique_ptr<Preparation> preparation;

  Process(const std::string& name, const std::shared_ptr<const transport::World>& world) {
    IntegratorSettings settings;
    settings.rr_depth = 5;
    settings.cache = cache;
    settings.single_scattering = SingleScattering::cached;
    integrator = make_integrator(name, world, settings);
  }

  std::string records() const {
    std::string bytes;
    const auto set = cache->records();
    for (size_t i = 0; i < set->size(); ++i) cache::append_record(bytes, set->record(i));
    return bytes;
  }
};

std::string run(Preparation& preparation, uint32_t task) {
  RayCounters counters;
  preparation.run(task, counters);
  return preparation.result(task);
}

/// Bytes changed, cut off and added: what a broken or hostile process might send. Either they are refused, or
/// they say something that could be.
void expect_checked(const std::string& bytes, std::mt19937& random,
                    const std::function<void(std::string)>& read) {
  for (int i = 0; i < 20; ++i) {
    std::string mutated = bytes;
    switch (random() % 3) {
      case 0:
        mutated.resize(random() % (bytes.size() + 1));
        break;
      case 1:
        mutated += static_cast<char>(random());
        break;
      default:
        for (uint32_t left = 1 + random() % 4; left > 0 && !mutated.empty(); --left)
          mutated[random() % std::min<size_t>(mutated.size(), left % 2 == 0 ? 16 : mutated.size())] =
              static_cast<char>(random() % 2 == 0 ? 0xff : random());
    }
    try {
      read(mutated);
    } catch (const Error& error) {
      EXPECT_EQ(error.reason(), "POISONED_RESULT");
    }
  }
}

/// One process has all tasks run by another, and a third one follows by outcomes; the fourth is alone.
void expect_processes_agree(const std::string& name, const std::shared_ptr<const transport::World>& world) {
  scene::prepare_render_thread();
  const TestCamera camera(world->scene().sensor, 24, 18);
  Process alone(name, world);
  Process first(name, world);
  Process second(name, world);
  std::mt19937 random(7);  // NOLINT(bugprone-random-generator-seed): the same damage every time
  for (const double error : {0.3, 0.1}) {
    const CacheTarget target{.error = error, .preview = error > 0.2};
    test::prepare(*alone.integrator, camera, target, 2);
    first.preparation = first.integrator->prepare(camera, target);
    second.preparation = second.integrator->prepare(camera, target);
    std::string outcome = first.preparation->outcome();
    uint32_t tasks = first.preparation->next_round();
    second.preparation->adopt(outcome);
    ASSERT_EQ(second.preparation->next_round(), tasks);
    while (tasks > 0) {
      for (uint32_t task = tasks; task-- > 0;) {
        const std::string result = run(*second.preparation, task);
        if (random() % 16 == 0 || task == 0)
          expect_checked(result, random,
                         [&](const std::string& bytes) { first.preparation->accept(task, bytes); });
        first.preparation->accept(task, result);
      }
      outcome = first.preparation->outcome();
      expect_checked(outcome, random, [&](const std::string& bytes) { second.preparation->adopt(bytes); });
      second.preparation->adopt(outcome);
      tasks = first.preparation->next_round();
      ASSERT_EQ(second.preparation->next_round(), tasks);
    }
    first.preparation = nullptr;
    second.preparation = nullptr;
    EXPECT_GT(alone.cache->records()->size(), 20u);
    EXPECT_EQ(first.records(), alone.records());
    EXPECT_EQ(second.records(), alone.records());
    EXPECT_EQ(first.integrator->cache_counts().records_new, alone.integrator->cache_counts().records_new);
  }
  const auto image = [&](const Process& process) {
    return test::take(*process.integrator, camera, 2, 2).mean;
  };
  const auto expected = image(alone);
  EXPECT_EQ(image(first), expected);
  EXPECT_EQ(image(second), expected);
}

TEST(SharedPreparation, OfARoomWithRatios) {
  expect_processes_agree("radiance-cache", foggy_room("0.5, 0.6, 0.7", "0.8"));
}

// Records that read records, and their sources.
TEST(SharedPreparation, OfDenseFog) {
  expect_processes_agree("radiance-cache", foggy_room("6, 6, 6", "0.98"));
}

TEST(SharedPreparation, OfAnisotropicFog) {
  expect_processes_agree("radiance-cache", foggy_room("0.5, 0.6, 0.7", "0.8", "0.4"));
}

TEST(SharedPreparation, OfTheRival) {
  expect_processes_agree("radiance-cache-unaware", foggy_room("0.5, 0.6, 0.7", "0.8"));
}

// In the middle of any round the time may be over: what is done by then is kept, here and there.
TEST(SharedPreparation, DroppedInTheMiddle) {
  scene::prepare_render_thread();
  const auto world = foggy_room("0.5, 0.6, 0.7", "0.8");
  const TestCamera camera(world->scene().sensor, 24, 18);
  for (const uint32_t rounds : {1u, 2u, 3u, 6u}) {
    Process first("radiance-cache", world);
    Process second("radiance-cache", world);
    first.preparation = first.integrator->prepare(camera, {.error = 0.2});
    second.preparation = second.integrator->prepare(camera, {.error = 0.2});
    for (uint32_t round = 0; round <= rounds; ++round) {
      second.preparation->adopt(first.preparation->outcome());
      const uint32_t tasks = first.preparation->next_round();
      ASSERT_EQ(second.preparation->next_round(), tasks);
      const uint32_t done = round < rounds ? tasks : tasks / 2;
      for (uint32_t task = 0; task < done; ++task)
        first.preparation->accept(task, run(*second.preparation, task));
    }
    second.preparation->adopt(first.preparation->outcome());
    first.preparation = nullptr;
    second.preparation = nullptr;
    EXPECT_EQ(first.records(), second.records());
    test::prepare(*first.integrator, camera, {.error = 0.2}, 2);
    test::prepare(*second.integrator, camera, {.error = 0.2}, 2);
    EXPECT_EQ(first.records(), second.records());
  }
}

}  // namespace
}  // namespace fogbank::integrators
