#include "scene/embree_round_shape.h"

namespace fogbank::scene {

namespace {

void round_shape_bounds(const RTCBoundsFunctionArguments* arguments) {
  const auto& shape = *static_cast<const RoundShape*>(arguments->geometryUserPtr);
  Vec3f lower;
  Vec3f upper;
  shape.bounds(lower, upper);
  RTCBounds& bounds = *arguments->bounds_o;
  bounds.lower_x = lower.x;
  bounds.lower_y = lower.y;
  bounds.lower_z = lower.z;
  bounds.upper_x = upper.x;
  bounds.upper_y = upper.y;
  bounds.upper_z = upper.z;
}

/// Ray `i` of a packet of `n` against a round shape; n = 1 for single rays.
bool intersect_lane(const RoundShape& shape, RTCRayN* rays, unsigned n, unsigned i, float& distance) {
  const Vec3d origin(RTCRayN_org_x(rays, n, i), RTCRayN_org_y(rays, n, i), RTCRayN_org_z(rays, n, i));
  const Vec3d direction(RTCRayN_dir_x(rays, n, i), RTCRayN_dir_y(rays, n, i), RTCRayN_dir_z(rays, n, i));
  return shape.intersect(origin, direction, RTCRayN_tnear(rays, n, i), RTCRayN_tfar(rays, n, i), distance);
}

void round_shape_intersect(const RTCIntersectFunctionNArguments* arguments) {
  const auto& shape = *static_cast<const RoundShape*>(arguments->geometryUserPtr);
  const unsigned n = arguments->N;
  RTCRayN* rays = RTCRayHitN_RayN(arguments->rayhit, n);
  RTCHitN* hits = RTCRayHitN_HitN(arguments->rayhit, n);
  for (unsigned i = 0; i < n; ++i) {
    if (arguments->valid[i] == 0) continue;
    float distance = 0;
    if (!intersect_lane(shape, rays, n, i, distance)) continue;
    RTCRayN_tfar(rays, n, i) = distance;
    RTCHitN_u(hits, n, i) = 0;
    RTCHitN_v(hits, n, i) = 0;
    RTCHitN_geomID(hits, n, i) = arguments->geomID;
    RTCHitN_primID(hits, n, i) = arguments->primID;
    RTCHitN_instID(hits, n, i, 0) = arguments->context->instID[0];
  }
}

void round_shape_occluded(const RTCOccludedFunctionNArguments* arguments) {
  const auto& shape = *static_cast<const RoundShape*>(arguments->geometryUserPtr);
  for (unsigned i = 0; i < arguments->N; ++i) {
    float distance = 0;
    if (arguments->valid[i] != 0 && intersect_lane(shape, arguments->ray, arguments->N, i, distance))
      RTCRayN_tfar(arguments->ray, arguments->N, i) = -infinity;
  }
}

}  // namespace

void set_round_shape(RTCGeometry geometry, const RoundShape& shape) {
  rtcSetGeometryUserPrimitiveCount(geometry, 1);
  // Embree hands it back to the functions above, which only read.
  rtcSetGeometryUserData(geometry, const_cast<RoundShape*>(&shape));
  rtcSetGeometryBoundsFunction(geometry, round_shape_bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry, round_shape_intersect);
  rtcSetGeometryOccludedFunction(geometry, round_shape_occluded);
}

}  // namespace fogbank::scene
