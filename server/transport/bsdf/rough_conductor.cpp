// `roughconductor`: rough metal, front side only.
//
// material, or eta and k                         as for `conductor`
// distribution, alpha or alpha_u with alpha_v    see parameters.h; default beckmann, 0.1
// specular_reflectance                           colour or texture in [0, 1], default 1
//
// f = F(wo . m) D(m) G1(wo) G1(wi) / (4 cos_o cos_i) with the half vector m (Walter et al. 2007, eq. 20; Cook
// and Torrance 1982), sampled by visible normals.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class RoughConductor final : public Bsdf {
 public:
  RoughConductor(MicrofacetType type, RoughnessParameters roughness, ConductorParameters index,
                 ColorParameter reflectance)
      : type_(type),
        roughness_(std::move(roughness)),
        index_(std::move(index)),
        reflectance_(std::move(reflectance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (!(wo.z > 0.0f && wi.z > 0.0f)) return {};
    return evaluate_facet(point, distribution(point), wo, wi, glm::normalize(wo + wi));
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float,
                                   const Vec2f& direction) const override {
    if (!(wo.z > 0.0f)) return std::nullopt;
    const MicrofacetDistribution facets = distribution(point);
    const Vec3f m = facets.sample_visible_normal(wo, direction);
    BsdfSample sample;
    sample.wi = reflect(wo, m);
    if (!(sample.wi.z > 0.0f)) return std::nullopt;
    const BsdfValue value = evaluate_facet(point, facets, wo, sample.wi, m);
    if (!(value.pdf > 0.0f)) return std::nullopt;
    sample.pdf = value.pdf;
    sample.weight = value.value / value.pdf;
    return sample;
  }

  bool has_smooth_lobes() const override { return true; }
  Spectrum albedo_estimate() const override {
    return reflectance_.mean() * fresnel_conductor(1.0f, index_.eta.mean(), index_.k.mean());
  }

 private:
  MicrofacetDistribution distribution(const ShadingPoint& point) const {
    return {type_, roughness_.alpha_u(point), roughness_.alpha_v(point)};
  }
  BsdfValue evaluate_facet(const ShadingPoint& point, const MicrofacetDistribution& facets, const Vec3f& wo,
                           const Vec3f& wi, const Vec3f& m) const {
    const float cosine = glm::dot(wo, m);
    if (!(cosine > 0.0f)) return {};
    const float scale = 0.25f * facets.density(m) * facets.masking_over_cosine(wo, m) * facets.masking(wi, m);
    const Spectrum fresnel = fresnel_conductor(std::fmin(cosine, 1.0f), index_.eta(point), index_.k(point));
    return {reflectance_(point) * fresnel * scale, facets.visible_normal_pdf(wo, m) / (4.0f * cosine)};
  }

  MicrofacetType type_;
  RoughnessParameters roughness_;
  ConductorParameters index_;
  ColorParameter reflectance_;
};

}  // namespace

BsdfPointer make_rough_conductor(scene::PropertyReader& reader, BsdfBuilder& builder) {
  ConductorParameters index = read_conductor(reader, builder);
  const MicrofacetType type = read_microfacet_type(reader);
  RoughnessParameters roughness = read_roughness(reader, builder);
  return std::make_shared<RoughConductor>(type, std::move(roughness), std::move(index),
                                          read_reflectance(reader, builder, "specular_reflectance", 1.0f));
}

}  // namespace fogbank::transport
