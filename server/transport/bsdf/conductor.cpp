// `conductor`: smooth metal, front side only.
//
// material              name of a preset (see material_presets.h), default "none": a perfect mirror
// eta, k                instead of `material`: real and imaginary index, colour or texture in [0, 100]
// specular_reflectance  colour or texture in [0, 1], default 1
//
// Mirror reflection with the Fresnel reflectance of a conductor.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class Conductor final : public Bsdf {
 public:
  Conductor(ConductorParameters index, ColorParameter reflectance)
      : index_(std::move(index)), reflectance_(std::move(reflectance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint&, const Vec3f&, const Vec3f&) const override { return {}; }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float,
                                   const Vec2f&) const override {
    if (!(wo.z > 0.0f)) return std::nullopt;
    BsdfSample sample;
    sample.wi = {-wo.x, -wo.y, wo.z};
    sample.pdf = 1;
    sample.delta = true;
    sample.weight = reflectance_(point) * fresnel_conductor(wo.z, index_.eta(point), index_.k(point));
    return sample;
  }

  bool has_smooth_lobes() const override { return false; }
  Spectrum albedo_estimate() const override {
    return reflectance_.mean() * fresnel_conductor(1.0f, index_.eta.mean(), index_.k.mean());
  }

 private:
  ConductorParameters index_;
  ColorParameter reflectance_;
};

}  // namespace

BsdfPointer make_conductor(scene::PropertyReader& reader, BsdfBuilder& builder) {
  ConductorParameters index = read_conductor(reader, builder);
  return std::make_shared<Conductor>(std::move(index),
                                     read_reflectance(reader, builder, "specular_reflectance", 1.0f));
}

}  // namespace fogbank::transport
