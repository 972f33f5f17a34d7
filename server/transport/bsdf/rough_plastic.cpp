// `roughplastic`: diffuse base under a rough dielectric coat, with the light that bounces between the two;
// front side only.
//
// int_ior                number in [0.1, 100] or name, default "polypropylene"
// ext_ior                the same, default "air"; the two must differ
// distribution           "beckmann" (default) or "ggx"
// alpha                  number in [0, 10], default 0.1
// diffuse_reflectance    colour or texture in [0, 1], default 0.5
// specular_reflectance   colour or texture in [0, 1], default 1
// nonlinear              boolean, default false: let the bounces between base and coat saturate the colour
//
// Specular: as `roughconductor` with the Fresnel reflectance of a dielectric. Diffuse, with d the base's
// reflectance, T the coat's transmittance and R its internal reflectance (see rough_interface.h):
//   f = T(wo) T(wi) / (pi eta^2) * d / (1 - R)      (nonlinear: d / (1 - d R)),
// Mitsuba 3's definition.
#include "core/sampling.h"
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"
#include "transport/rough_interface.h"

namespace fogbank::transport {

namespace {

class RoughPlastic final : public Bsdf {
 public:
  RoughPlastic(float eta, const MicrofacetDistribution& facets, std::shared_ptr<const RoughInterface> coat,
               ColorParameter diffuse, ColorParameter specular, bool nonlinear)
      : eta_(eta),
        inverse_eta_squared_(1.0f / (eta * eta)),
        facets_(facets),
        coat_(std::move(coat)),
        diffuse_(std::move(diffuse)),
        specular_(std::move(specular)),
        nonlinear_(nonlinear) {
    const float total = mean(diffuse_.mean()) + mean(specular_.mean());
    specular_weight_ = total > 0.0f ? mean(specular_.mean()) / total : 1.0f;
  }

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (!(wo.z > 0.0f && wi.z > 0.0f)) return {};
    return evaluate(point, wo, wi, coat_->transmittance(wo.z));
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    if (!(wo.z > 0.0f)) return std::nullopt;
    const float transmittance = coat_->transmittance(wo.z);
    BsdfSample sample;
    sample.wi = lobe < specular_probability(transmittance)
                    ? reflect(wo, facets_.sample_visible_normal(wo, direction))
                    : square_to_cosine_hemisphere(direction);
    if (!(sample.wi.z > 0.0f)) return std::nullopt;
    const BsdfValue value = evaluate(point, wo, sample.wi, transmittance);
    if (!(value.pdf > 0.0f)) return std::nullopt;
    sample.pdf = value.pdf;
    sample.weight = value.value / value.pdf;
    return sample;
  }

  bool has_smooth_lobes() const override { return true; }
  Spectrum albedo_estimate() const override {
    const float reflected = fresnel_diffuse_reflectance(eta_);
    return specular_.mean() * reflected +
           (1.0f - reflected) * (1.0f - coat_->internal_reflectance()) * under_coat(diffuse_.mean());
  }

 private:
  float specular_probability(float transmittance) const {
    const float specular = (1.0f - transmittance) * specular_weight_;
    const float diffuse = transmittance * (1.0f - specular_weight_);
    return specular + diffuse > 0.0f ? specular / (specular + diffuse) : 1.0f;
  }
  /// Base's reflectance with the bounces between it and the coat.
  Spectrum under_coat(const Spectrum& reflectance) const {
    return nonlinear_ ? reflectance / (Spectrum(1) - reflectance * coat_->internal_reflectance())
                      : reflectance / (1.0f - coat_->internal_reflectance());
  }
  BsdfValue evaluate(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi,
                     float transmittance_o) const {
    const Vec3f m = glm::normalize(wo + wi);
    const float cosine = glm::dot(wo, m);
    // Opposite grazing directions have no half vector where denormals are flushed, as in render threads: m is
    // no number.
    const bool has_facet = cosine > 0.0f;
    const float specular = has_facet
                               ? 0.25f * fresnel_dielectric(cosine, eta_).reflectance * facets_.density(m) *
                                     facets_.masking_over_cosine(wo, m) * facets_.masking(wi, m)
                               : 0.0f;
    const float cosine_pdf = inv_pi * wi.z;
    const float diffuse = cosine_pdf * inverse_eta_squared_ * transmittance_o * coat_->transmittance(wi.z);
    const float probability = specular_probability(transmittance_o);
    const float specular_pdf = has_facet ? facets_.visible_normal_pdf(wo, m) / (4.0f * cosine) : 0.0f;
    return {specular_(point) * specular + under_coat(diffuse_(point)) * diffuse,
            probability * specular_pdf + (1.0f - probability) * cosine_pdf};
  }

  float eta_;
  float inverse_eta_squared_;
  MicrofacetDistribution facets_;
  std::shared_ptr<const RoughInterface> coat_;
  ColorParameter diffuse_;
  ColorParameter specular_;
  bool nonlinear_;
  float specular_weight_ = 1;  ///< steers samples to the specular lobe
};

}  // namespace

BsdfPointer make_rough_plastic(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const float eta = read_unequal_relative_index(reader, "polypropylene");
  const MicrofacetType type = read_microfacet_type(reader);
  const float alpha = std::fmax(MicrofacetDistribution::least_alpha,
                                static_cast<float>(reader.number("alpha", 0.1, 0.0, largest_alpha)));
  ColorParameter diffuse = read_reflectance(reader, builder, "diffuse_reflectance", 0.5f);
  ColorParameter specular = read_reflectance(reader, builder, "specular_reflectance", 1.0f);
  const bool nonlinear = reader.boolean("nonlinear", false);
  return std::make_shared<RoughPlastic>(eta, MicrofacetDistribution(type, alpha, alpha),
                                        builder.rough_interface(type, alpha, eta), std::move(diffuse),
                                        std::move(specular), nonlinear);
}

}  // namespace fogbank::transport
