// `thindielectric`: a pane so thin that light leaves it where and in the direction in which it came;
// two-sided.
//
// int_ior, ext_ior                              as for `dielectric`
// specular_reflectance, specular_transmittance  colour or texture in [0, 1], default 1
//
// Reflectance with all internal reflections: R' = R + T R T + T R^3 T + ... = 2 R / (1 + R). The rest goes
// straight on, is not a scattering event, and shadow rays see it.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class ThinDielectric final : public Bsdf {
 public:
  ThinDielectric(float eta, ColorParameter reflectance, ColorParameter transmittance)
      : eta_(eta), reflectance_(std::move(reflectance)), transmittance_(std::move(transmittance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint&, const Vec3f&, const Vec3f&) const override { return {}; }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f&) const override {
    const float reflected = total_reflectance(wo);
    BsdfSample sample;
    sample.delta = true;
    if (lobe < reflected) {
      sample.wi = {-wo.x, -wo.y, wo.z};
      sample.pdf = reflected;
      sample.weight = reflectance_(point);
    } else {
      sample.wi = -wo;
      sample.pdf = 1.0f - reflected;
      sample.null = true;
      sample.weight = transmittance_(point);
    }
    return sample;
  }

  Spectrum null_transmission(const ShadingPoint& point, const Vec3f& wo) const override {
    return transmittance_(point) * (1.0f - total_reflectance(wo));
  }
  bool transmits() const override { return true; }
  bool has_smooth_lobes() const override { return false; }
  Spectrum albedo_estimate() const override {
    const float once = fresnel_diffuse_reflectance(eta_);
    const float reflected = 2.0f * once / (1.0f + once);
    return reflectance_.mean() * reflected + transmittance_.mean() * (1.0f - reflected);
  }

 private:
  float total_reflectance(const Vec3f& wo) const {
    const float once = fresnel_dielectric(std::fabs(wo.z), eta_).reflectance;
    return 2.0f * once / (1.0f + once);
  }

  float eta_;
  ColorParameter reflectance_;
  ColorParameter transmittance_;
};

}  // namespace

BsdfPointer make_thin_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const float eta = read_relative_index(reader, "bk7");
  ColorParameter reflectance = read_reflectance(reader, builder, "specular_reflectance", 1.0f);
  return std::make_shared<ThinDielectric>(eta, std::move(reflectance),
                                          read_reflectance(reader, builder, "specular_transmittance", 1.0f));
}

}  // namespace fogbank::transport
