// Records of the irradiance of surfaces by light that doesn't come straight from an emitter.
#pragma once

#include "cache/record_maker.h"
#include "derivatives/hemisphere_rays.h"
#include "derivatives/irradiance_gather.h"
#include "transport/path_tracer.h"

namespace fogbank::cache {

/// A record belongs to one side of a surface: Wish::normal is the shading normal, turned to that side, whose
/// cosine weighs the light as it does in a Lambertian BSDF; rays leave from the side of the geometric normal
/// that is nearer to it. So records follow smooth normals of meshes and show no facets.
/// Wish::component.medium lies on that side. Light of medium and surfaces is path traced, or CachedLight of
/// the generation before (reads_records).
class IrradianceRecordMaker final : public RecordMaker {
 public:
  IrradianceRecordMaker(std::shared_ptr<const transport::World> world, const RecordMakerSettings& settings);

  Record make(const Wish& wish, RayCounters& counters) const override;
  uint64_t id_of(const Wish& wish) const override;

 private:
  derivatives::SurfaceSide side_of(const Wish& wish, RayCounters& counters) const;

  std::shared_ptr<const transport::World> world_;
  RecordMakerSettings settings_;
  std::shared_ptr<const transport::PathTracer> kernel_;
};

}  // namespace fogbank::cache
