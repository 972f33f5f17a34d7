// `dielectric`: smooth interface between two dielectrics; the normal points to the exterior.
//
// int_ior                 index of refraction behind the normal: number in [0.1, 100] or name, default "bk7"
// ext_ior                 the same before it, default "air"
// specular_reflectance    colour or texture in [0, 1], default 1
// specular_transmittance  colour or texture in [0, 1], default 1
//
// Fresnel's equations choose between reflection and refraction; refracted radiance scales by 1 / eta^2 (Veach
// 1997, section 5.2). Equal indices give a surface that lets everything through but, unlike `null`, counts as
// a scattering event and stops shadow rays.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class Dielectric final : public Bsdf {
 public:
  Dielectric(float eta, ColorParameter reflectance, ColorParameter transmittance)
      : eta_(eta), reflectance_(std::move(reflectance)), transmittance_(std::move(transmittance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint&, const Vec3f&, const Vec3f&) const override { return {}; }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f&) const override {
    if (wo.z == 0.0f) return std::nullopt;
    const DielectricFresnel fresnel = fresnel_dielectric(wo.z, eta_);
    BsdfSample sample;
    sample.delta = true;
    if (lobe < fresnel.reflectance) {
      sample.wi = {-wo.x, -wo.y, wo.z};
      sample.pdf = fresnel.reflectance;
      sample.weight = reflectance_(point);
    } else {
      sample.wi = {-fresnel.eta_ti * wo.x, -fresnel.eta_ti * wo.y, fresnel.cos_theta_t};
      sample.pdf = 1.0f - fresnel.reflectance;
      sample.eta = fresnel.eta_it;
      sample.weight = transmittance_(point) * sqr(fresnel.eta_ti);
    }
    return sample;
  }

  bool transmits() const override { return true; }
  bool has_smooth_lobes() const override { return false; }
  Spectrum albedo_estimate() const override {
    const float reflected = fresnel_diffuse_reflectance(eta_);
    return reflectance_.mean() * reflected + transmittance_.mean() * (1.0f - reflected);
  }

 private:
  float eta_;
  ColorParameter reflectance_;
  ColorParameter transmittance_;
};

}  // namespace

BsdfPointer make_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const float eta = read_relative_index(reader, "bk7");
  ColorParameter reflectance = read_reflectance(reader, builder, "specular_reflectance", 1.0f);
  return std::make_shared<Dielectric>(eta, std::move(reflectance),
                                      read_reflectance(reader, builder, "specular_transmittance", 1.0f));
}

}  // namespace fogbank::transport
