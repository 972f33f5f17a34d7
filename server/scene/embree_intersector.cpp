// Ray queries on Embree 3.
#include <embree3/rtcore.h>
#include <immintrin.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "core/error.h"
#include "scene/embree_packets.h"
#include "scene/embree_round_shape.h"
#include "scene/intersector.h"
#include "scene/round_shape.h"
#include "scene/scene.h"

namespace fogbank::scene {

namespace {

/// Geometry masks: a shadow ray asks for solid surfaces only, so one accelerator of all surfaces serves both
/// it and the nearest-hit query.
constexpr uint32_t solid_mask = 1;
constexpr uint32_t passing_mask = 2;

struct DeviceRelease {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneRelease {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
struct GeometryRelease {
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using DevicePointer = std::unique_ptr<RTCDeviceTy, DeviceRelease>;
using ScenePointer = std::unique_ptr<RTCSceneTy, SceneRelease>;
using GeometryPointer = std::unique_ptr<RTCGeometryTy, GeometryRelease>;

/// Sets this thread's MXCSR for its life time and puts the caller's back.
class FloatModeGuard {
 public:
  FloatModeGuard() : before_(_mm_getcsr()) { prepare_render_thread(); }
  ~FloatModeGuard() { _mm_setcsr(before_); }
  FloatModeGuard(const FloatModeGuard&) = delete;
  FloatModeGuard& operator=(const FloatModeGuard&) = delete;

 private:
  unsigned before_;
};

RTCRay make_ray(const Ray& ray, uint32_t mask) {
  constexpr float time = 0;
  return {ray.origin.x,
          ray.origin.y,
          ray.origin.z,
          open_start,
          ray.direction.x,
          ray.direction.y,
          ray.direction.z,
          time,
          open_end(ray.max_distance),
          mask,
          0,
          0};
}

}  // namespace

struct Intersector::Implementation {
  const Scene& source;
  std::mutex error_mutex;
  std::string error_message;  ///< first message of Embree's since the last check
  std::atomic<int64_t> bytes{0};
  std::vector<std::unique_ptr<RoundShape>> round_shapes;
  std::vector<std::vector<uint32_t>> group_shapes;  ///< group -> geometry id within it -> shape
  DevicePointer device;
  std::vector<ScenePointer> group_all;      ///< by group
  std::vector<ScenePointer> group_passing;  ///< by group; null when nothing in it passes light
  ScenePointer all;
  ScenePointer passing;  ///< null when no surface passes light
  double seconds = 0;

  explicit Implementation(const Scene& scene) : source(scene) {}

  void build();
  [[gnu::always_inline]] bool query(RTCScene accelerator, const Ray& ray, uint32_t mask, Hit& hit) const;
  void query(RTCScene accelerator, const RayBundle& bundle, uint32_t mask, std::span<Hit> hits) const;

 private:
  void check();
  ScenePointer new_scene();
  void commit(RTCScene scene);
  [[gnu::always_inline]] bool translate(const RawHit& raw, Hit& hit) const;
  GeometryPointer make_geometry(const Shape& shape);
  GeometryPointer make_mesh(const Mesh& mesh);
  GeometryPointer make_instance(const Instance& instance, RTCScene target);
  void build_groups();
};

void Intersector::Implementation::check() {
  const RTCError code = rtcGetDeviceError(device.get());
  std::string message;
  {
    const std::lock_guard lock(error_mutex);
    message.swap(error_message);
  }
  if (code == RTC_ERROR_NONE) return;
  if (code == RTC_ERROR_OUT_OF_MEMORY)
    throw Error(ErrorKind::resource_exhausted, "ACCELERATOR_OUT_OF_MEMORY",
                "no memory for the ray acceleration structure: " + message);
  throw Error(ErrorKind::internal, "ACCELERATOR_FAILED", "Embree: " + message);
}

ScenePointer Intersector::Implementation::new_scene() {
  ScenePointer scene(rtcNewScene(device.get()));
  check();
  // Robust: the edge tests of two triangles agree on a shared edge, so that closed meshes are closed for
  // rays. Of a million rays aimed at edges of a closed mesh none gets out, where 45 000 do without; it costs
  // 8 to 25 % of the ray rate (two scenes of 100 000 triangles). A higher build quality changes nothing in
  // this mode: Embree has no builder with spatial splits for it.
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(scene.get(), RTC_BUILD_QUALITY_MEDIUM);
  return scene;
}

void Intersector::Implementation::commit(RTCScene scene) {
  rtcCommitScene(scene);
  check();
}

GeometryPointer Intersector::Implementation::make_mesh(const Mesh& mesh) {
  GeometryPointer geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE));
  check();
  // Embree reads whole 16-byte words, so the last position of a shared buffer needs 4 readable bytes behind
  // it.
  if (mesh.positions.capacity() > mesh.positions.size()) {
    rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                               mesh.positions.data(), 0, sizeof(Vec3f), mesh.positions.size());
  } else {
    void* copy = rtcSetNewGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                         sizeof(Vec3f), mesh.positions.size());
    check();
    std::copy(mesh.positions.begin(), mesh.positions.end(), static_cast<Vec3f*>(copy));
  }
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.triangles.data(), 0, sizeof(Vec3u), mesh.triangles.size());
  check();
  return geometry;
}

GeometryPointer Intersector::Implementation::make_geometry(const Shape& shape) {
  GeometryPointer geometry;
  if (shape.kind == ShapeKind::triangle_mesh) {
    geometry = make_mesh(source.meshes[static_cast<size_t>(shape.mesh)]);
  } else {
    round_shapes.push_back(std::make_unique<RoundShape>(shape.kind, shape.to_world));
    geometry.reset(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_USER));
    check();
    set_round_shape(geometry.get(), *round_shapes.back());
  }
  rtcSetGeometryMask(geometry.get(), shape.passes_light ? passing_mask : solid_mask);
  rtcCommitGeometry(geometry.get());
  check();
  return geometry;
}

GeometryPointer Intersector::Implementation::make_instance(const Instance& instance, RTCScene target) {
  GeometryPointer geometry(rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_INSTANCE));
  check();
  rtcSetGeometryInstancedScene(geometry.get(), target);
  const glm::mat4 to_world(instance.to_world);
  rtcSetGeometryTransform(geometry.get(), 0, RTC_FORMAT_FLOAT4X4_COLUMN_MAJOR, &to_world[0][0]);
  rtcSetGeometryMask(geometry.get(), solid_mask | passing_mask);
  rtcCommitGeometry(geometry.get());
  check();
  return geometry;
}

void Intersector::Implementation::build_groups() {
  const auto count = static_cast<size_t>(source.group_count);
  group_shapes.resize(count);
  group_all.resize(count);
  group_passing.resize(count);
  for (uint32_t i = 0; i < source.shapes.size(); ++i) {
    const Shape& shape = source.shapes[i];
    if (shape.group == none) continue;
    const auto group = static_cast<size_t>(shape.group);
    const auto id = static_cast<unsigned>(group_shapes[group].size());
    group_shapes[group].push_back(i);
    const GeometryPointer geometry = make_geometry(shape);
    if (group_all[group] == nullptr) group_all[group] = new_scene();
    rtcAttachGeometryByID(group_all[group].get(), geometry.get(), id);
    if (!shape.passes_light) continue;
    if (group_passing[group] == nullptr) group_passing[group] = new_scene();
    rtcAttachGeometryByID(group_passing[group].get(), geometry.get(), id);
  }
  for (size_t group = 0; group < count; ++group) {
    if (group_all[group] != nullptr) commit(group_all[group].get());
    if (group_passing[group] != nullptr) commit(group_passing[group].get());
  }
}

void Intersector::Implementation::build() {
  device.reset(rtcNewDevice(nullptr));
  if (device == nullptr)
    throw Error(ErrorKind::internal, "ACCELERATOR_FAILED",
                "Embree could not start (error " + std::to_string(rtcGetDeviceError(nullptr)) + ")");
  rtcSetDeviceErrorFunction(
      device.get(),
      [](void* self, RTCError, const char* text) {
        auto& implementation = *static_cast<Implementation*>(self);
        const std::lock_guard lock(implementation.error_mutex);
        if (implementation.error_message.empty()) implementation.error_message = text;
      },
      this);
  rtcSetDeviceMemoryMonitorFunction(
      device.get(),
      [](void* self, ssize_t change, bool) {
        static_cast<Implementation*>(self)->bytes += change;
        return true;
      },
      this);

  build_groups();
  all = new_scene();
  for (uint32_t i = 0; i < source.shapes.size(); ++i) {
    const Shape& shape = source.shapes[i];
    if (shape.group != none) continue;
    const GeometryPointer geometry = make_geometry(shape);
    rtcAttachGeometryByID(all.get(), geometry.get(), i);
    if (!shape.passes_light) continue;
    if (passing == nullptr) passing = new_scene();
    rtcAttachGeometryByID(passing.get(), geometry.get(), i);
  }
  const auto first_instance = static_cast<unsigned>(source.shapes.size());
  for (unsigned i = 0; i < source.instances.size(); ++i) {
    const Instance& instance = source.instances[i];
    const auto group = static_cast<size_t>(instance.group);
    if (group_all[group] == nullptr) continue;
    rtcAttachGeometryByID(all.get(), make_instance(instance, group_all[group].get()).get(),
                          first_instance + i);
    if (group_passing[group] == nullptr) continue;
    if (passing == nullptr) passing = new_scene();
    rtcAttachGeometryByID(passing.get(), make_instance(instance, group_passing[group].get()).get(),
                          first_instance + i);
  }
  commit(all.get());
  if (passing != nullptr) commit(passing.get());
}

inline bool Intersector::Implementation::translate(const RawHit& raw, Hit& hit) const {
  if (raw.geometry == RTC_INVALID_GEOMETRY_ID) return false;
  hit.distance = raw.distance;
  hit.parameters = raw.parameters;
  hit.primitive = raw.primitive;
  if (raw.instance == RTC_INVALID_GEOMETRY_ID) {
    hit.shape = raw.geometry;
    hit.instance = none;
  } else {
    const size_t instance = raw.instance - source.shapes.size();
    hit.shape = group_shapes[static_cast<size_t>(source.instances[instance].group)][raw.geometry];
    hit.instance = static_cast<int32_t>(instance);
  }
  return true;
}

inline bool Intersector::Implementation::query(RTCScene accelerator, const Ray& ray, uint32_t mask,
                                               Hit& hit) const {
  if (!(ray.max_distance > 0)) return false;
  RTCRayHit query;
  query.ray = make_ray(ray, mask);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(accelerator, &context, &query);
  return translate(
      {query.ray.tfar, {query.hit.u, query.hit.v}, query.hit.primID, query.hit.geomID, query.hit.instID[0]},
      hit);
}

void Intersector::Implementation::query(RTCScene accelerator, const RayBundle& bundle, uint32_t mask,
                                        std::span<Hit> hits) const {
  // Raw hits of a batch live on the stack; a whole number of packets.
  constexpr size_t batch_size = 256;
  std::array<RawHit, batch_size> raw;
  for (size_t first = 0; first < bundle.directions.size(); first += batch_size) {
    const size_t count = std::min(batch_size, bundle.directions.size() - first);
    const bool shared_distance = bundle.max_distances.size() == 1;
    const RayBundle batch{
        bundle.origin, bundle.directions.subspan(first, count),
        shared_distance ? bundle.max_distances : bundle.max_distances.subspan(first, count)};
    intersect_packets(accelerator, batch, mask, raw);
    for (size_t i = 0; i < count; ++i) {
      hits[first + i] = Hit{};
      translate(raw[i], hits[first + i]);
    }
  }
}

Intersector::Intersector(const Scene& scene) : implementation_(std::make_unique<Implementation>(scene)) {
  const auto start = std::chrono::steady_clock::now();
  // An arena of its own keeps the build's tasks apart from whatever the calling thread is in the middle of.
  // Its width follows the process's limit on threads; Embree's hierarchy does not depend on it (tested), and
  // with the hierarchy the choice among surfaces at exactly the same distance.
  tbb::task_arena arena;
  arena.execute([this] {
    const FloatModeGuard float_mode;
    implementation_->build();
  });
  implementation_->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

Intersector::~Intersector() = default;

bool Intersector::intersect(const Ray& ray, Hit& hit) const {
  return implementation_->query(implementation_->all.get(), ray, solid_mask | passing_mask, hit);
}

bool Intersector::intersect_solid(const Ray& ray, Hit& hit) const {
  return implementation_->query(implementation_->all.get(), ray, solid_mask, hit);
}

bool Intersector::intersect_passing(const Ray& ray, Hit& hit) const {
  return implementation_->passing != nullptr &&
         implementation_->query(implementation_->passing.get(), ray, passing_mask, hit);
}

bool Intersector::occluded(const Ray& ray) const {
  if (!(ray.max_distance > 0)) return false;
  RTCRay query = make_ray(ray, solid_mask);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(implementation_->all.get(), &context, &query);
  return query.tfar < 0;
}

void Intersector::intersect_solid(const RayBundle& bundle, std::span<Hit> hits) const {
  implementation_->query(implementation_->all.get(), bundle, solid_mask, hits);
}

void Intersector::intersect_passing(const RayBundle& bundle, std::span<Hit> hits) const {
  if (implementation_->passing != nullptr) {
    implementation_->query(implementation_->passing.get(), bundle, passing_mask, hits);
  } else {
    std::fill(hits.begin(), hits.end(), Hit{});
  }
}

void Intersector::occluded(const RayBundle& bundle, std::span<uint8_t> occluded) const {
  occluded_packets(implementation_->all.get(), bundle, solid_mask, occluded);
}

void Intersector::occluded(std::span<const Ray> rays, std::span<uint8_t> occluded) const {
  occluded_packets(implementation_->all.get(), rays, solid_mask, occluded);
}

bool Intersector::has_passing_surfaces() const { return implementation_->passing != nullptr; }
double Intersector::build_seconds() const { return implementation_->seconds; }
size_t Intersector::memory_bytes() const { return static_cast<size_t>(implementation_->bytes.load()); }

void prepare_render_thread() {
  _MM_SET_FLUSH_ZERO_MODE(_MM_FLUSH_ZERO_ON);
  _MM_SET_DENORMALS_ZERO_MODE(_MM_DENORMALS_ZERO_ON);
}

}  // namespace fogbank::scene
