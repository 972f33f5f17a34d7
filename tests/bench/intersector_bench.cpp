// Rays per second of scene::Intersector against Embree called with nothing around it, on the same hierarchy
// and the same rays, and the time of Scene::interaction. Run with --benchmark_repetitions=5 and compare
// medians of a pair.
#include <benchmark/benchmark.h>
#include <embree3/rtcore.h>

#include <vector>

#include "core/random.h"
#include "core/sampling.h"
#include "scene/scene.h"

namespace fogbank::scene {
namespace {

constexpr size_t ray_count = 1 << 16;

/// A bumpy closed surface of 98 000 triangles inside a box.
Scene make_scene() {
  constexpr uint32_t rings = 222;
  constexpr uint32_t segments = 221;
  Mesh mesh;
  for (uint32_t ring = 0; ring <= rings; ++ring) {
    for (uint32_t segment = 0; segment < segments; ++segment) {
      const float theta = pi * static_cast<float>(ring) / rings;
      const float phi = 2 * pi * static_cast<float>(segment) / segments;
      const float radius = 1.0f + 0.05f * std::sin(20 * theta) * std::sin(30 * phi);
      mesh.positions.push_back(
          radius * Vec3f(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta)));
      if (ring == rings) continue;
      const uint32_t next = (segment + 1) % segments;
      const uint32_t here = ring * segments;
      mesh.triangles.push_back({here + segment, here + segments + segment, here + segments + next});
      mesh.triangles.push_back({here + segment, here + segments + next, here + next});
    }
  }
  mesh.positions.reserve(mesh.positions.size() + 1);
  Mesh box;
  for (int i = 0; i < 8; ++i)
    box.positions.push_back({(i & 1) ? 3.0f : -3.0f, (i & 2) ? 3.0f : -3.0f, (i & 4) ? 3.0f : -3.0f});
  box.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                   {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
  Scene scene;
  scene.meshes = {std::move(mesh), std::move(box)};
  for (int32_t i = 0; i < 2; ++i) {
    Shape shape;
    shape.mesh = i;
    scene.shapes.push_back(shape);
  }
  return scene;
}

struct Fixture {
  Scene scene = make_scene();
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene bare = rtcNewScene(device);
  std::vector<Ray> coherent;    ///< a camera's, row by row
  std::vector<Ray> incoherent;  ///< between random points

  Fixture() {
    prepare_render_thread();
    scene.intersector = std::make_unique<Intersector>(scene);
    rtcSetSceneFlags(bare, RTC_SCENE_FLAG_ROBUST);
    for (const Mesh& mesh : scene.meshes) {
      RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
      void* vertices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                               sizeof(Vec3f), mesh.positions.size());
      std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<Vec3f*>(vertices));
      void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                              sizeof(Vec3u), mesh.triangles.size());
      std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<Vec3u*>(indices));
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(bare, geometry);
      rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(bare);

    RandomStream random(1, 2, 3, 4);
    for (size_t i = 0; i < ray_count; ++i) {
      const size_t row = i / 256;
      const Vec2f film(static_cast<float>(i % 256) / 128 - 1, static_cast<float>(row) / 128 - 1);
      coherent.push_back({{0, 0, 2.8f}, glm::normalize(Vec3f(film, -1.5f)), infinity});
      const Vec3f from = 1.5f * square_to_uniform_sphere(random.next_vec2());
      const Vec3f to = 1.5f * square_to_uniform_sphere(random.next_vec2());
      incoherent.push_back({from, glm::normalize(to - from), glm::distance(from, to)});
    }
  }
  ~Fixture() {
    rtcReleaseScene(bare);
    rtcReleaseDevice(device);
  }

  const std::vector<Ray>& rays(bool is_coherent) const { return is_coherent ? coherent : incoherent; }
};

const Fixture& fixture() {
  static const Fixture shared;
  return shared;
}

RTCRay bare_ray(const Ray& ray) {
  return {ray.origin.x,
          ray.origin.y,
          ray.origin.z,
          0.0f,
          ray.direction.x,
          ray.direction.y,
          ray.direction.z,
          0.0f,
          ray.max_distance,
          ~0u,
          0u,
          0u};
}

void closest_hit(benchmark::State& state) {
  const Fixture& f = fixture();
  const auto& rays = f.rays(state.range(0) != 0);
  size_t i = 0;
  for (auto _ : state) {
    Hit hit;
    benchmark::DoNotOptimize(f.scene.intersector->intersect(rays[i++ % ray_count], hit));
    benchmark::DoNotOptimize(hit);
  }
  state.SetItemsProcessed(state.iterations());
}

void closest_hit_bare(benchmark::State& state) {
  const Fixture& f = fixture();
  const auto& rays = f.rays(state.range(0) != 0);
  size_t i = 0;
  for (auto _ : state) {
    RTCRayHit query;
    query.ray = bare_ray(rays[i++ % ray_count]);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(f.bare, &context, &query);
    benchmark::DoNotOptimize(query);
  }
  state.SetItemsProcessed(state.iterations());
}

void any_hit(benchmark::State& state) {
  const Fixture& f = fixture();
  const auto& rays = f.rays(state.range(0) != 0);
  size_t i = 0;
  for (auto _ : state) benchmark::DoNotOptimize(f.scene.intersector->occluded(rays[i++ % ray_count]));
  state.SetItemsProcessed(state.iterations());
}

void any_hit_bare(benchmark::State& state) {
  const Fixture& f = fixture();
  const auto& rays = f.rays(state.range(0) != 0);
  size_t i = 0;
  for (auto _ : state) {
    RTCRay query = bare_ray(rays[i++ % ray_count]);
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(f.bare, &context, &query);
    benchmark::DoNotOptimize(query);
  }
  state.SetItemsProcessed(state.iterations());
}

void interaction(benchmark::State& state) {
  const Fixture& f = fixture();
  std::vector<Hit> hits(ray_count);
  for (size_t i = 0; i < ray_count; ++i) f.scene.intersector->intersect(f.coherent[i], hits[i]);
  size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(f.scene.interaction(f.coherent[i % ray_count], hits[i % ray_count]));
    ++i;
  }
  state.SetItemsProcessed(state.iterations());
}

BENCHMARK(closest_hit)->ArgName("coherent")->Arg(1)->Arg(0);
BENCHMARK(closest_hit_bare)->ArgName("coherent")->Arg(1)->Arg(0);
BENCHMARK(any_hit)->ArgName("coherent")->Arg(1)->Arg(0);
BENCHMARK(any_hit_bare)->ArgName("coherent")->Arg(1)->Arg(0);
BENCHMARK(interaction);

}  // namespace
}  // namespace fogbank::scene

BENCHMARK_MAIN();
