// `plastic`: diffuse base under a smooth dielectric coat, with the light that bounces between the two; front
// side only.
//
// int_ior                number in [0.1, 100] or name, default "polypropylene"
// ext_ior                the same, default "air"
// diffuse_reflectance    colour or texture in [0, 1], default 0.5
// specular_reflectance   colour or texture in [0, 1], default 1
// nonlinear              boolean, default false: let the bounces between base and coat saturate the colour
//
// Specular: mirror reflection by Fresnel's F. Diffuse, with d the base's reflectance and Fi the coat's
// diffuse reflectance from inside:
//   f = (1 - F(wo)) (1 - F(wi)) / (pi eta^2) * d / (1 - Fi)      (nonlinear: d / (1 - d Fi))
// which is the geometric series of the bounces (Mitsuba 3's definition, after Shirley 1991).
#include "core/sampling.h"
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

class Plastic final : public Bsdf {
 public:
  Plastic(float eta, ColorParameter diffuse, ColorParameter specular, bool nonlinear)
      : eta_(eta),
        inverse_eta_squared_(1.0f / (eta * eta)),
        internal_reflectance_(fresnel_diffuse_reflectance(1.0f / eta)),
        diffuse_(std::move(diffuse)),
        specular_(std::move(specular)),
        nonlinear_(nonlinear) {
    const float total = mean(diffuse_.mean()) + mean(specular_.mean());
    specular_weight_ = total > 0.0f ? mean(specular_.mean()) / total : 1.0f;
  }

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (!(wo.z > 0.0f && wi.z > 0.0f)) return {};
    const float fresnel = fresnel_dielectric(wo.z, eta_).reflectance;
    return evaluate_diffuse(point, fresnel, wi);
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    if (!(wo.z > 0.0f)) return std::nullopt;
    const float fresnel = fresnel_dielectric(wo.z, eta_).reflectance;
    const float probability = specular_probability(fresnel);
    BsdfSample sample;
    if (lobe < probability) {
      sample.wi = {-wo.x, -wo.y, wo.z};
      sample.pdf = probability;
      sample.delta = true;
      sample.weight = specular_(point) * (fresnel / probability);
      return sample;
    }
    sample.wi = square_to_cosine_hemisphere(direction);
    const BsdfValue diffuse = evaluate_diffuse(point, fresnel, sample.wi);
    if (!(diffuse.pdf > 0.0f)) return std::nullopt;
    sample.pdf = diffuse.pdf;
    sample.weight = diffuse.value / diffuse.pdf;
    return sample;
  }

  bool has_smooth_lobes() const override { return true; }
  Spectrum albedo_estimate() const override {
    const float reflected = fresnel_diffuse_reflectance(eta_);
    return specular_.mean() * reflected +
           (1.0f - reflected) * (1.0f - internal_reflectance_) * under_coat(diffuse_.mean());
  }

 private:
  float specular_probability(float fresnel) const {
    const float specular = fresnel * specular_weight_;
    const float diffuse = (1.0f - fresnel) * (1.0f - specular_weight_);
    return specular + diffuse > 0.0f ? specular / (specular + diffuse) : 1.0f;
  }
  /// Base's reflectance with the bounces between it and the coat.
  Spectrum under_coat(const Spectrum& reflectance) const {
    return nonlinear_ ? reflectance / (Spectrum(1) - reflectance * internal_reflectance_)
                      : reflectance / (1.0f - internal_reflectance_);
  }
  BsdfValue evaluate_diffuse(const ShadingPoint& point, float fresnel_o, const Vec3f& wi) const {
    const float cosine_pdf = inv_pi * wi.z;
    const float fresnel_i = fresnel_dielectric(wi.z, eta_).reflectance;
    const float scale = cosine_pdf * inverse_eta_squared_ * (1.0f - fresnel_o) * (1.0f - fresnel_i);
    return {under_coat(diffuse_(point)) * scale, cosine_pdf * (1.0f - specular_probability(fresnel_o))};
  }

  float eta_;
  float inverse_eta_squared_;
  float internal_reflectance_;
  ColorParameter diffuse_;
  ColorParameter specular_;
  bool nonlinear_;
  float specular_weight_ = 1;  ///< steers samples to the specular lobe
};

}  // namespace

BsdfPointer make_plastic(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const float eta = read_relative_index(reader, "polypropylene");
  ColorParameter diffuse = read_reflectance(reader, builder, "diffuse_reflectance", 0.5f);
  ColorParameter specular = read_reflectance(reader, builder, "specular_reflectance", 1.0f);
  const bool nonlinear = reader.boolean("nonlinear", false);
  return std::make_shared<Plastic>(eta, std::move(diffuse), std::move(specular), nonlinear);
}

}  // namespace fogbank::transport
