// The light around a record of generation k, read from the records of generation k - 1: what gathers take
// instead of tracing paths.
#pragma once

#include <optional>

#include "cache/index.h"
#include "cache/record_maker.h"
#include "derivatives/medium_gather.h"
#include "derivatives/source.h"
#include "transport/path_tracer.h"

namespace fogbank::cache {

/// Is the record of `wish` made of the records of the generation before? Generation 0 holds paths of
/// max_depth edges at most. Sources are records made as if the camera saw them, so that generation k holds up
/// to k edges more, light that is weaker than all that counts by the albedo to the power of max_depth. Where
/// that may be more than a trace every generation is path traced.
inline bool reads_records(const Wish& wish, const RecordMakerSettings& settings) {
  constexpr int32_t least_depth = 8;
  return wish.component.scattering_order > 0 && (settings.max_depth < 0 || settings.max_depth >= least_depth);
}

/// What the light that leaves a hit towards its ray's origin follows from.
struct LambertianHit {
  Spectrum reflectance{0};
  Wish irradiance;  ///< the record that would tell the rest
};

/// nullopt where it takes more than irradiance. `generation`: of the record.
std::optional<LambertianHit> lambertian(const transport::World& world, const derivatives::SurfaceHit& hit,
                                        uint8_t generation);

/// Where CachedLight of `generation` would be looked up along rays from `origin`: one place in each medium
/// they cross, drawn by transmittance, and each Lambertian surface of `hits`.
std::vector<Wish> places_along(const transport::World& world, const Vec3f& origin,
                               std::span<const derivatives::MediumRay> rays,
                               std::span<const derivatives::SurfaceHit> hits, uint8_t generation,
                               RandomStream& random);

/// Light straight from emitters is sampled at the emitters; the rest is looked up in records of one
/// generation, and path traced where none reaches: unbiased but for what the records' own errors are.
/// For one record; cheap to make; look-ups need no lock.
class CachedLight final : public derivatives::MediumSource,
                          public derivatives::LineSource,
                          public derivatives::SurfaceSource {
 public:
  /// Scattering events between the camera and what is read here: one, at the record's own place.
  static constexpr int32_t depth = 1;

  /// `kernel` traces paths of any length; `records` may be null: everything is path traced then. Both must
  /// outlive this. `generation`: of the records that are read.
  CachedLight(const transport::PathTracer& kernel, const Epoch* records, uint8_t generation);

  Spectrum mean_radiance(const Vec3f& y, int32_t medium, RandomStream& random,
                         RayCounters& counters) const override;
  void mean_radiance_at(std::span<const Vec3f> points, int32_t medium, RandomStream& random,
                        RayCounters& counters, std::span<Spectrum> results) const override;
  /// Lambertian surfaces by their irradiance, others path traced.
  Spectrum leaving_radiance(const derivatives::SurfaceHit& hit, int32_t samples, RandomStream& random,
                            RayCounters& counters) const override;
  /// Radiance that arrives along `ray` from surfaces that scatter light and from the medium that holds its
  /// origin (scene::none: vacuum); emission met by the ray itself is left out. One sample, finite, >= 0.
  /// `solid_hit`: what ends the ray, clear surfaces being passed; of infinite distance where nothing does.
  Spectrum arriving_radiance(Ray ray, int32_t medium, RandomStream& random, RayCounters& counters,
                             scene::Hit* solid_hit) const;

  Spectrum in_scattered(const Ray& ray, float length, int32_t medium, RandomStream& random,
                        RayCounters& counters) const override;

 private:
  /// Of each medium; null where there is no record.
  const Index* rest_index(int32_t medium) const;
  /// Mean radiance that doesn't come straight from an emitter: one path.
  Spectrum rest_by_path(const Vec3f& y, int32_t medium, RandomStream& random, RayCounters& counters) const;

  const transport::PathTracer& kernel_;
  const transport::World& world_;
  const Epoch* records_;
  uint8_t generation_;
};

}  // namespace fogbank::cache
