// `roughdielectric`: rough interface between two dielectrics, e.g. ground glass; the normal points to the
// exterior.
//
// int_ior, ext_ior                               as for `dielectric`, but not equal
// distribution, alpha or alpha_u with alpha_v    see parameters.h; default beckmann, 0.1
// specular_reflectance, specular_transmittance   colour or texture in [0, 1], default 1
//
// Walter et al. 2007, eqs. 20 and 21, refracted radiance scaled by 1 / eta^2; sampled by visible normals,
// then by Fresnel's reflectance.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class RoughDielectric final : public Bsdf {
 public:
  RoughDielectric(float eta, MicrofacetType type, RoughnessParameters roughness, ColorParameter reflectance,
                  ColorParameter transmittance)
      : eta_(eta),
        type_(type),
        roughness_(std::move(roughness)),
        reflectance_(std::move(reflectance)),
        transmittance_(std::move(transmittance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (wo.z == 0.0f || wi.z == 0.0f) return {};
    const bool reflected = wo.z * wi.z > 0.0f;
    // Half vector of reflection or refraction, turned to the side of the surface's normal.
    Vec3f m = wo + wi * (reflected ? 1.0f : (wo.z > 0.0f ? eta_ : 1.0f / eta_));
    const float length = glm::length(m);
    if (!(length > 0.0f)) return {};
    m /= std::copysign(length, m.z);
    return evaluate_facet(point, distribution(point), wo, wi, m, fresnel_dielectric(glm::dot(wo, m), eta_));
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    if (wo.z == 0.0f) return std::nullopt;
    const MicrofacetDistribution facets = distribution(point);
    const Vec3f m = facets.sample_visible_normal(wo.z > 0.0f ? wo : -wo, direction);
    const DielectricFresnel fresnel = fresnel_dielectric(glm::dot(wo, m), eta_);
    const bool reflected = lobe < fresnel.reflectance;
    BsdfSample sample;
    sample.wi = reflected ? reflect(wo, m) : refract(wo, m, fresnel.cos_theta_t, fresnel.eta_ti);
    if (!(reflected ? wo.z * sample.wi.z > 0.0f : wo.z * sample.wi.z < 0.0f)) return std::nullopt;
    const BsdfValue value = evaluate_facet(point, facets, wo, sample.wi, m, fresnel);
    if (!(value.pdf > 0.0f)) return std::nullopt;
    sample.pdf = value.pdf;
    sample.weight = value.value / value.pdf;
    sample.eta = reflected ? 1.0f : fresnel.eta_it;
    return sample;
  }

  bool transmits() const override { return true; }
  bool has_smooth_lobes() const override { return true; }
  Spectrum albedo_estimate() const override {
    const float reflected = fresnel_diffuse_reflectance(eta_);
    return reflectance_.mean() * reflected + transmittance_.mean() * (1.0f - reflected);
  }

 private:
  MicrofacetDistribution distribution(const ShadingPoint& point) const {
    return {type_, roughness_.alpha_u(point), roughness_.alpha_v(point)};
  }
  BsdfValue evaluate_facet(const ShadingPoint& point, const MicrofacetDistribution& facets, const Vec3f& wo,
                           const Vec3f& wi, const Vec3f& m, const DielectricFresnel& fresnel) const {
    const float cos_o = glm::dot(wo, m);
    const float cos_i = glm::dot(wi, m);
    // Neither direction may see the facet from behind.
    if (!(cos_o * wo.z > 0.0f && cos_i * wi.z > 0.0f)) return {};
    const float pdf = facets.visible_normal_pdf(wo.z > 0.0f ? wo : -wo, m);
    const float scale = facets.density(m) * facets.masking_over_cosine(wo, m) * facets.masking(wi, m);
    if (wo.z * wi.z > 0.0f)
      return {reflectance_(point) * (0.25f * fresnel.reflectance * scale),
              pdf * fresnel.reflectance / (4.0f * std::fabs(cos_i))};
    const float transmitted = 1.0f - fresnel.reflectance;
    // |dm / dwi| without its factor eta^2, which the scale of radiance cancels in the value.
    const float jacobian = std::fabs(cos_i) / sqr(cos_o + fresnel.eta_it * cos_i);
    return {transmittance_(point) * (transmitted * scale * std::fabs(cos_o) * jacobian),
            pdf * transmitted * sqr(fresnel.eta_it) * jacobian};
  }

  float eta_;
  MicrofacetType type_;
  RoughnessParameters roughness_;
  ColorParameter reflectance_;
  ColorParameter transmittance_;
};

}  // namespace

BsdfPointer make_rough_dielectric(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const float eta = read_unequal_relative_index(reader, "bk7");
  const MicrofacetType type = read_microfacet_type(reader);
  RoughnessParameters roughness = read_roughness(reader, builder);
  ColorParameter reflectance = read_reflectance(reader, builder, "specular_reflectance", 1.0f);
  return std::make_shared<RoughDielectric>(eta, type, std::move(roughness), std::move(reflectance),
                                           read_reflectance(reader, builder, "specular_transmittance", 1.0f));
}

}  // namespace fogbank::transport
