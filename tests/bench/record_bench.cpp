// What a record costs, stage by stage, in scenes given on the command line; one JSON object a line. All times
// are CPU seconds of one thread for one record, means over the points; records.py divides and prints.
//
//   record_bench SCENE.xml POINTS DIRECTIONS...
//
// The points lie on camera rays, in the medium that the camera is in, at random shares of the way to the
// first surface.
#include <embree3/rtcore.h>
#include <time.h>

#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>

#include "derivatives/path_source.h"
#include "derivatives/plan_request.h"
#include "derivatives/random_at.h"
#include "derivatives/sphere_gather.h"
#include "scene/loader.h"

namespace fogbank::derivatives {
namespace {

/// Adds up the CPU time between construction and destruction.
class Stopwatch {
 public:
  explicit Stopwatch(double& seconds) : seconds_(seconds), start_(now()) {}
  ~Stopwatch() { seconds_ += now() - start_; }
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;

 private:
  static double now() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
  }
  double& seconds_;
  double start_;
};

std::vector<Vec3f> points_in_view(const transport::World& world, int count) {
  const scene::Scene& scene = world.scene();
  RandomStream random(1, 0, 0, 0);
  std::vector<Vec3f> points;
  while (static_cast<int>(points.size()) < count) {
    const Vec2f film = random.next_vec2() * Vec2f(scene.film.width, scene.film.height);
    const Ray ray = scene.sensor.sample_ray(scene.film, film, random.next_vec2());
    const float share = random.next_float();
    scene::Hit hit;
    if (!scene.intersector->intersect(ray, hit)) continue;
    points.push_back(ray.at(share * hit.distance));
  }
  return points;
}

/// Embree with nothing around it, holding the scene's meshes (no instances, no round shapes).
class BareEmbree {
 public:
  explicit BareEmbree(const scene::Scene& scene)
      : device_(rtcNewDevice(nullptr)), scene_(rtcNewScene(device_)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    for (const scene::Shape& shape : scene.shapes) {
      if (shape.kind != scene::ShapeKind::triangle_mesh || shape.passes_light || shape.group != scene::none)
        continue;
      const scene::Mesh& mesh = scene.meshes[static_cast<size_t>(shape.mesh)];
      RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
      void* positions = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                sizeof(Vec3f), mesh.positions.size());
      std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<Vec3f*>(positions));
      void* triangles = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                sizeof(Vec3u), mesh.triangles.size());
      std::copy(mesh.triangles.begin(), mesh.triangles.end(), static_cast<Vec3u*>(triangles));
      rtcCommitGeometry(geometry);
      rtcAttachGeometry(scene_, geometry);
      rtcReleaseGeometry(geometry);
    }
    rtcCommitScene(scene_);
  }
  ~BareEmbree() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }
  BareEmbree(const BareEmbree&) = delete;
  BareEmbree& operator=(const BareEmbree&) = delete;

  /// Sum of distances, so that nothing is optimised away.
  float closest(const Vec3f& origin, std::span<const Vec3f> directions) const {
    float sum = 0;
    for (const Vec3f& direction : directions) {
      RTCRayHit query;
      query.ray = ray(origin, direction, infinity);
      query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      rtcIntersect1(scene_, &context, &query);
      sum += query.ray.tfar;
    }
    return sum;
  }
  int occluded(const Vec3f& origin, std::span<const Vec3f> directions, float distance) const {
    int count = 0;
    for (const Vec3f& direction : directions) {
      RTCRay query = ray(origin, direction, distance);
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      rtcOccluded1(scene_, &context, &query);
      count += query.tfar < 0 ? 1 : 0;
    }
    return count;
  }

 private:
  static RTCRay ray(const Vec3f& o, const Vec3f& d, float distance) {
    return {o.x, o.y, o.z, 0, d.x, d.y, d.z, 0, distance, ~0u, 0, 0};
  }
  RTCDevice device_;
  RTCScene scene_;
};

/// A fan of directions towards a target of angular radius 0.1, as a light's grid has, row by row.
std::vector<Vec3f> light_fan(const Vec3f& axis, int side) {
  const Frame frame = Frame::from_normal(axis);
  std::vector<Vec3f> fan;
  for (int i = 0; i < side; ++i) {
    for (int j = 0; j < side; ++j) {
      const Vec2f at = (Vec2f(i, j) + 0.5f) / static_cast<float>(side) * 2.0f - 1.0f;
      fan.push_back(glm::normalize(axis + 0.1f * (at.x * frame.tangent + at.y * frame.bitangent)));
    }
  }
  return fan;
}

nlohmann::json measure(const std::shared_ptr<const transport::World>& world, const BareEmbree& bare,
                       const std::vector<Vec3f>& points, int32_t directions) {
  EstimatorSettings settings;
  settings.samples = directions;
  settings.order = Order::single;
  const transport::Plan plan(*world, plan_request(settings));
  const auto gather_for = [&](DerivativeOrder order, bool bisect) {
    EstimatorSettings other = settings;
    other.derivatives = order;
    other.bisect = bisect;
    return SphereGather(world, other);
  };
  const SphereGather value = gather_for(DerivativeOrder::value, false);
  const SphereGather gradient = gather_for(DerivativeOrder::gradient, false);
  const SphereGather plain = gather_for(DerivativeOrder::hessian, false);
  const SphereGather bisected = gather_for(DerivativeOrder::hessian, true);

  const PathTracedSource paths(std::make_shared<transport::PathTracer>(world, transport::PathSettings{}), 1);
  const scene::Intersector& intersector = *world->scene().intersector;
  std::map<std::string, double> seconds;
  RayCounters counters;
  uint64_t rays = 0;
  uint64_t bisection_rays = 0;
  float sink = 0;
  SphereSamples samples(*world, plan);
  Sightlines lines(*world);
  const float anywhere = infinity;
  for (const Vec3f& x : points) {
    const int32_t medium = world->medium_at(x);
    const auto timed = [&](const char* stage, const auto& work) {
      const Stopwatch watch(seconds[stage]);
      work();
    };
    const auto gather_stage = [&](const SphereGather& gather, const char* stage) {
      const Stopwatch watch(seconds[stage]);
      const RadianceJet jet = gather.gather(samples);
      sink += static_cast<float>(jet.luminance().value);
    };
    {
      RandomStream random = random_at(x, 0, 0, 0);
      const Stopwatch watch(seconds["trace"]);
      value.trace(x, medium, random, samples, counters);
    }
    rays += samples.rays.ends().size();
    const std::vector<Vec3f> sphere(samples.rays.lines().directions().begin(),
                                    samples.rays.lines().directions().end());
    std::vector<scene::Hit> hits(sphere.size());
    std::vector<uint8_t> occluded(sphere.size());
    const scene::RayBundle bundle{x, sphere, {&anywhere, 1}};
    {
      RandomStream random = random_at(x, 0, 0, 0);
      timed("directions", [&] { sink += stratified_directions(samples.rays.topology(), random)[0].x; });
    }
    timed("lines", [&] {
      lines.start(x, medium);
      lines.append(sphere, {&anywhere, 1}, counters);
    });
    timed("embree_closest", [&] { sink += bare.closest(x, sphere); });
    timed("single_closest", [&] {
      for (size_t i = 0; i < sphere.size(); ++i) {
        scene::Hit hit;
        intersector.intersect_solid({x, sphere[i], infinity}, hit);
        sink += hit.distance;
      }
    });
    timed("packet_closest", [&] { intersector.intersect_solid(bundle, hits); });
    timed("embree_any", [&] { sink += static_cast<float>(bare.occluded(x, sphere, infinity)); });
    timed("packet_any", [&] { intersector.occluded(bundle, occluded); });
    const std::vector<Vec3f> fan = light_fan(sphere.front(), static_cast<int>(std::sqrt(sphere.size())));
    const scene::RayBundle fan_bundle{x, fan, {&anywhere, 1}};
    timed("embree_fan_closest", [&] { sink += bare.closest(x, fan); });
    timed("packet_fan_closest", [&] { intersector.intersect_solid(fan_bundle, hits); });
    timed("embree_fan_any", [&] { sink += static_cast<float>(bare.occluded(x, fan, infinity)); });
    timed("packet_fan_any", [&] { intersector.occluded(fan_bundle, occluded); });

    {
      RandomStream random = random_at(x, 0, 0, 1);
      const Stopwatch watch(seconds["radiance"]);
      value.sample_radiance(paths, random, samples, counters);
    }
    gather_stage(value, "value");
    timed("jumps", [&] { plain.find_outlines(samples, counters); });
    gather_stage(gradient, "gradient");
    gather_stage(plain, "hessian");
    const uint64_t before = counters.total();
    timed("outlines", [&] { bisected.find_outlines(samples, counters); });
    bisection_rays += counters.total() - before;
    gather_stage(bisected, "hessian_bisected");
  }
  nlohmann::json result{
      {"rays", rays / points.size()},
      {"bisection_rays", static_cast<double>(bisection_rays) / static_cast<double>(points.size())},
      {"finite", std::isfinite(sink)}};
  for (const auto& [stage, time] : seconds) result[stage] = time / static_cast<double>(points.size());
  return result;
}

void run(const std::filesystem::path& path, int point_count, const std::vector<int32_t>& directions) {
  scene::prepare_render_thread();
  const auto world = std::make_shared<const transport::World>(
      scene::load_scene(path.filename(), scene::folder_source(path.parent_path()), {}));
  const BareEmbree bare(world->scene());
  for (const int32_t n : directions) {
    // Large records are few, so that each size takes much the same time.
    const int count = std::max(2, std::min(point_count, point_count * 4096 / n));
    const std::vector<Vec3f> points = points_in_view(*world, count);
    measure(world, bare, {points.front()}, n);
    std::cout << measure(world, bare, points, n) << std::endl;
  }
}

}  // namespace
}  // namespace fogbank::derivatives

int main(int count, char** arguments) {
  if (count < 4) {
    std::cerr << "usage: record_bench SCENE.xml POINTS DIRECTIONS...\n";
    return 2;
  }
  try {
    std::vector<int32_t> directions;
    for (int i = 3; i < count; ++i) directions.push_back(std::stoi(arguments[i]));
    fogbank::derivatives::run(arguments[1], std::stoi(arguments[2]), directions);
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
