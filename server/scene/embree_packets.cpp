#include "scene/embree_packets.h"

#include <algorithm>

namespace fogbank::scene {

namespace {

/// Rays of one packet. A constant, not the processor's width: the bundle is cut in the same places
/// everywhere.
constexpr size_t width = 16;

template <typename Rays>
void fill_lane(Rays& rays, size_t lane, const Vec3f& origin, const Vec3f& direction, float max_distance,
               uint32_t mask) {
  rays.org_x[lane] = origin.x;
  rays.org_y[lane] = origin.y;
  rays.org_z[lane] = origin.z;
  rays.tnear[lane] = open_start;
  rays.dir_x[lane] = direction.x;
  rays.dir_y[lane] = direction.y;
  rays.dir_z[lane] = direction.z;
  rays.time[lane] = 0;
  rays.tfar[lane] = max_distance > 0 ? open_end(max_distance) : 0;
  rays.mask[lane] = mask;
  rays.id[lane] = 0;
  rays.flags[lane] = 0;
}

Ray ray_of(const RayBundle& bundle, size_t ray) {
  return {bundle.origin, bundle.directions[ray], bundle.max_distance(ray)};
}
Ray ray_of(std::span<const Ray> rays, size_t ray) { return rays[ray]; }
size_t size_of(const RayBundle& bundle) { return bundle.directions.size(); }
size_t size_of(std::span<const Ray> rays) { return rays.size(); }

/// Fills all lanes from ray `first` on; those beyond the last ray repeat it and are not valid.
template <typename Rays, typename Source>
void fill(Rays& rays, int* valid, const Source& source, size_t first, uint32_t mask) {
  for (size_t lane = 0; lane < width; ++lane) {
    const Ray ray = ray_of(source, std::min(first + lane, size_of(source) - 1));
    fill_lane(rays, lane, ray.origin, ray.direction, ray.max_distance, mask);
    valid[lane] = first + lane < size_of(source) && ray.max_distance > 0 ? -1 : 0;
  }
}

RTCIntersectContext make_context(RTCIntersectContextFlags flags) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = flags;
  return context;
}

template <typename Source>
void trace_occluded(RTCScene scene, const Source& source, uint32_t mask, std::span<uint8_t> occluded) {
  // The coherent traversal of 3.13 doesn't return from some any-hit queries of scenes with instances.
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT);
  RTCRay16 packet;
  alignas(64) int valid[width];
  for (size_t first = 0; first < size_of(source); first += width) {
    fill(packet, valid, source, first, mask);
    rtcOccluded16(valid, scene, &context, &packet);
    const size_t count = std::min(width, size_of(source) - first);
    for (size_t lane = 0; lane < count; ++lane)
      occluded[first + lane] = static_cast<uint8_t>(valid[lane] != 0 && packet.tfar[lane] < 0);
  }
}

}  // namespace

void intersect_packets(RTCScene scene, const RayBundle& bundle, uint32_t mask, std::span<RawHit> hits) {
  RTCIntersectContext context = make_context(RTC_INTERSECT_CONTEXT_FLAG_COHERENT);
  RTCRayHit16 packet;
  alignas(64) int valid[width];
  for (size_t first = 0; first < bundle.directions.size(); first += width) {
    fill(packet.ray, valid, bundle, first, mask);
    std::fill_n(packet.hit.geomID, width, RTC_INVALID_GEOMETRY_ID);
    std::fill_n(packet.hit.instID[0], width, RTC_INVALID_GEOMETRY_ID);
    rtcIntersect16(valid, scene, &context, &packet);
    const size_t count = std::min(width, bundle.directions.size() - first);
    for (size_t lane = 0; lane < count; ++lane) {
      hits[first + lane] = {packet.ray.tfar[lane],
                            {packet.hit.u[lane], packet.hit.v[lane]},
                            packet.hit.primID[lane],
                            packet.hit.geomID[lane],
                            packet.hit.instID[0][lane]};
    }
  }
}

void occluded_packets(RTCScene scene, const RayBundle& bundle, uint32_t mask, std::span<uint8_t> occluded) {
  trace_occluded(scene, bundle, mask, occluded);
}

void occluded_packets(RTCScene scene, std::span<const Ray> rays, uint32_t mask, std::span<uint8_t> occluded) {
  trace_occluded(scene, rays, mask, occluded);
}

}  // namespace fogbank::scene
