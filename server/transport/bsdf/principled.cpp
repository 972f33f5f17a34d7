// `principled`: Disney's artist-friendly BSDF (Burley 2012, "Physically Based Shading at Disney"; Burley
// 2015, "Extending the Disney BRDF to a BSDF with Integrated Subsurface Scattering") as Mitsuba 3 defines it.
//
// Numbers or textures in [0, 1], default 0 unless stated:
//   base_color (colour, 0.5), roughness (0.5), anisotropic, metallic, spec_trans, spec_tint, sheen,
//   sheen_tint, flatness, clearcoat, clearcoat_gloss
// eta, or else specular            interior over exterior index, [0.1, 100]; or the number in [0, 1] (default
//                                  0.5) that gives eta = 2 / (1 - sqrt(0.08 specular)) - 1
// main_specular_sampling_rate, clearcoat_sampling_rate, diffuse_reflectance_sampling_rate
//                                  numbers in [0, 1000], default 1: how often each lobe is sampled
//
// Throws CONFLICTING_PARAMETERS for eta with specular.
//
// Lobes: diffuse with retro-reflection and a flattened variant, sheen, GGX reflection and refraction, and a
// clearcoat. Diffuse and specular are added without taking one from the other, so a white base reflects up to
// a few per cent, and with full sheen more, than it receives: the model's, not an oversight here.
#include "core/sampling.h"
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"
#include "transport/bsdf/principled_lobes.h"
#include "transport/fresnel.h"

namespace fogbank::transport {

namespace {

struct PrincipledParameters {
  ColorParameter base_color;
  NumberParameter roughness, anisotropic, metallic, spec_trans, spec_tint, sheen, sheen_tint, flatness,
      clearcoat, clearcoat_gloss;
  float eta = 1.5f;
  float specular_rate = 1;
  float clearcoat_rate = 1;
  float diffuse_rate = 1;
};

/// The model at one point.
struct Surface {
  float metallic;
  float opaque;       ///< weight of the reflecting lobes
  float transparent;  ///< weight of refraction
  float clearcoat;
  MicrofacetDistribution facets;
};

/// Probabilities of the lobes; they sum to 1, or are all 0 where nothing can be sampled.
struct LobeProbabilities {
  float diffuse = 0;
  float clearcoat = 0;
  float specular = 0;  ///< reflection and refraction, told apart by `reflection_share`
};

class Principled final : public Bsdf {
 public:
  explicit Principled(PrincipledParameters parameters) : parameters_(std::move(parameters)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (wo.z == 0.0f || wi.z == 0.0f) return {};
    const Surface surface = surface_at(point);
    if (wo.z < 0.0f && !(surface.transparent > 0.0f)) return {};
    const bool reflected = wo.z * wi.z > 0.0f;
    Vec3f m = wo + wi * (reflected ? 1.0f : (wo.z > 0.0f ? parameters_.eta : 1.0f / parameters_.eta));
    const float length = glm::length(m);
    if (!(length > 0.0f)) return {};
    m /= std::copysign(length, m.z);

    const DielectricFresnel fresnel = fresnel_dielectric(glm::dot(wo, m), parameters_.eta);
    const LobeProbabilities probabilities = lobe_probabilities(surface, wo);
    const bool facet_seen = glm::dot(wo, m) * wo.z > 0.0f && glm::dot(wi, m) * wi.z > 0.0f;
    BsdfValue result;
    if (facet_seen) add_specular(result, point, surface, probabilities.specular, fresnel, wo, wi, m);
    if (reflected && wo.z > 0.0f) {
      if (facet_seen) add_clearcoat(result, point, surface, probabilities.clearcoat, wo, wi, m);
      add_diffuse(result, point, surface, wo, wi, m);
      result.pdf += probabilities.diffuse * inv_pi * wi.z;
    }
    return result;
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    if (wo.z == 0.0f) return std::nullopt;
    const Surface surface = surface_at(point);
    if (wo.z < 0.0f && !(surface.transparent > 0.0f)) return std::nullopt;
    const LobeProbabilities probabilities = lobe_probabilities(surface, wo);
    BsdfSample sample;
    bool reflected = true;
    if (lobe < probabilities.diffuse) {
      sample.wi = square_to_cosine_hemisphere(direction);
    } else if (lobe < probabilities.diffuse + probabilities.clearcoat) {
      sample.wi = reflect(wo, clearcoat_lobe(point).sample(direction));
    } else {
      if (!(probabilities.specular > 0.0f)) return std::nullopt;
      const float rest = (lobe - probabilities.diffuse - probabilities.clearcoat) / probabilities.specular;
      const Vec3f m = surface.facets.sample_visible_normal(wo.z > 0.0f ? wo : -wo, direction);
      const DielectricFresnel fresnel = fresnel_dielectric(glm::dot(wo, m), parameters_.eta);
      reflected = rest < reflection_share(surface, fresnel, wo);
      sample.wi = reflected ? reflect(wo, m) : refract(wo, m, fresnel.cos_theta_t, fresnel.eta_ti);
      if (!reflected) sample.eta = fresnel.eta_it;
    }
    if (!(reflected ? wo.z * sample.wi.z > 0.0f : wo.z * sample.wi.z < 0.0f)) return std::nullopt;
    const BsdfValue value = evaluate_with_pdf(point, wo, sample.wi);
    if (!(value.pdf > 0.0f)) return std::nullopt;
    sample.pdf = value.pdf;
    sample.weight = value.value / value.pdf;
    return sample;
  }

  bool transmits() const override { return parameters_.spec_trans.mean() > 0.0f; }
  bool has_smooth_lobes() const override { return true; }
  Spectrum albedo_estimate() const override { return parameters_.base_color.mean(); }

 private:
  Surface surface_at(const ShadingPoint& point) const {
    const float metallic = parameters_.metallic(point);
    const float spec_trans = parameters_.spec_trans(point);
    // Burley 2012, section 5.4.
    constexpr float least_alpha = 0.001f;
    const float alpha = sqr(parameters_.roughness(point));
    const float aspect = std::sqrt(1.0f - 0.9f * parameters_.anisotropic(point));
    return {metallic, (1.0f - metallic) * (1.0f - spec_trans), (1.0f - metallic) * spec_trans,
            parameters_.clearcoat(point),
            MicrofacetDistribution(MicrofacetType::ggx, std::fmax(least_alpha, alpha / aspect),
                                   std::fmax(least_alpha, alpha * aspect))};
  }

  LobeProbabilities lobe_probabilities(const Surface& surface, const Vec3f& wo) const {
    if (wo.z < 0.0f) return {0, 0, 1};
    const float diffuse = surface.opaque * parameters_.diffuse_rate;
    const float clearcoat = 0.25f * surface.clearcoat * parameters_.clearcoat_rate;
    const float total = diffuse + clearcoat + parameters_.specular_rate;
    if (!(total > 0.0f)) return {};
    return {diffuse / total, clearcoat / total, parameters_.specular_rate / total};
  }

  /// Probability of reflection once the specular lobe is chosen.
  static float reflection_share(const Surface& surface, const DielectricFresnel& fresnel, const Vec3f& wo) {
    return wo.z > 0.0f ? 1.0f - surface.transparent * (1.0f - fresnel.reflectance) : fresnel.reflectance;
  }

  ClearcoatLobe clearcoat_lobe(const ShadingPoint& point) const {
    return ClearcoatLobe(parameters_.clearcoat_gloss(point));
  }

  void add_specular(BsdfValue& result, const ShadingPoint& point, const Surface& surface, float probability,
                    const DielectricFresnel& fresnel, const Vec3f& wo, const Vec3f& wi,
                    const Vec3f& m) const {
    const float cos_o = glm::dot(wo, m);
    const float cos_i = glm::dot(wi, m);
    const float pdf = probability * surface.facets.visible_normal_pdf(wo.z > 0.0f ? wo : -wo, m);
    const float scale =
        surface.facets.density(m) * surface.facets.masking_over_cosine(wo, m) * surface.facets.masking(wi, m);
    const float share = reflection_share(surface, fresnel, wo);
    const Spectrum base_color = parameters_.base_color(point);
    if (wo.z * wi.z > 0.0f) {
      // Mitsuba drops the whole lobe, a metal's too, where the dielectric reflects nothing (eta = 1).
      if (fresnel.reflectance > 0.0f)
        result.value +=
            specular_fresnel(point, surface, fresnel.reflectance, base_color, cos_o, wo) * (0.25f * scale);
      result.pdf += pdf * share / (4.0f * std::fabs(cos_i));
    } else if (surface.transparent > 0.0f) {
      // As in roughdielectric: the Jacobian's eta^2 cancels against the scale of radiance in the value.
      const float jacobian = std::fabs(cos_i) / sqr(cos_o + fresnel.eta_it * cos_i);
      result.value += glm::sqrt(base_color) * (surface.transparent * (1.0f - fresnel.reflectance) * scale *
                                               std::fabs(cos_o) * jacobian);
      result.pdf += pdf * (1.0f - share) * sqr(fresnel.eta_it) * jacobian;
    }
  }

  /// Blend of the dielectric's reflectance, its tinted variant and the metal's (Schlick's, towards the base
  /// colour); from inside the plain dielectric.
  Spectrum specular_fresnel(const ShadingPoint& point, const Surface& surface, float dielectric,
                            const Spectrum& base_color, float cosine, const Vec3f& wo) const {
    if (wo.z < 0.0f) return Spectrum(surface.transparent * dielectric);
    const float spec_tint = parameters_.spec_tint(point);
    const float weight = schlick_weight_refracted(cosine, parameters_.eta);
    Spectrum result((1.0f - surface.metallic) * (1.0f - spec_tint) * dielectric);
    if (surface.metallic > 0.0f) result += surface.metallic * schlick(base_color, weight);
    if (spec_tint > 0.0f) {
      const float normal_reflectance = sqr((parameters_.eta - 1.0f) / (parameters_.eta + 1.0f));
      result +=
          (1.0f - surface.metallic) * spec_tint * schlick(tint_of(base_color) * normal_reflectance, weight);
    }
    return result;
  }

  void add_clearcoat(BsdfValue& result, const ShadingPoint& point, const Surface& surface, float probability,
                     const Vec3f& wo, const Vec3f& wi, const Vec3f& m) const {
    if (!(surface.clearcoat > 0.0f)) return;
    const float density = clearcoat_lobe(point).density(m);
    const float cosine = glm::dot(wo, m);
    const float fresnel = schlick(0.04f, schlick_weight_refracted(cosine, parameters_.eta));
    result.value += Spectrum(0.25f * surface.clearcoat * fresnel * density * ClearcoatLobe::masking(wo) *
                             ClearcoatLobe::masking(wi) * wi.z);
    result.pdf += probability * density * m.z / (4.0f * glm::dot(wi, m));
  }

  /// Diffuse, retro-reflection, flattened diffuse (Burley 2015, section 4.2) and sheen.
  void add_diffuse(BsdfValue& result, const ShadingPoint& point, const Surface& surface, const Vec3f& wo,
                   const Vec3f& wi, const Vec3f& m) const {
    const float sheen = parameters_.sheen(point) * (1.0f - surface.metallic);
    if (!(surface.opaque > 0.0f) && !(sheen > 0.0f)) return;
    const Spectrum base_color = parameters_.base_color(point);
    const float cos_d = glm::dot(m, wi);
    if (surface.opaque > 0.0f) {
      const float shape =
          diffuse_shape(wo.z, wi.z, cos_d, parameters_.roughness(point), parameters_.flatness(point));
      result.value += base_color * (surface.opaque * wi.z * inv_pi * shape);
    }
    if (sheen > 0.0f) {
      const Spectrum tint = glm::mix(Spectrum(1), tint_of(base_color), parameters_.sheen_tint(point));
      result.value += tint * (sheen * schlick_weight(std::fabs(cos_d)) * wi.z);
    }
  }

  PrincipledParameters parameters_;
};

}  // namespace

BsdfPointer make_principled(scene::PropertyReader& reader, BsdfBuilder& builder) {
  constexpr double largest_rate = 1000;
  const auto number = [&](std::string_view name, float fallback) {
    return read_number(reader, builder, name, fallback, 0.0f, 1.0f);
  };
  PrincipledParameters parameters{read_reflectance(reader, builder, "base_color", 0.5f),
                                  number("roughness", 0.5f),
                                  number("anisotropic", 0.0f),
                                  number("metallic", 0.0f),
                                  number("spec_trans", 0.0f),
                                  number("spec_tint", 0.0f),
                                  number("sheen", 0.0f),
                                  number("sheen_tint", 0.0f),
                                  number("flatness", 0.0f),
                                  number("clearcoat", 0.0f),
                                  number("clearcoat_gloss", 0.0f)};
  if (reader.has("eta") && reader.has("specular"))
    reader.fail("CONFLICTING_PARAMETERS", "give either 'eta' or 'specular', not both");
  const bool refracts = parameters.spec_trans.varies() || parameters.spec_trans.mean() > 0.0f;
  if (reader.has("eta")) {
    parameters.eta = static_cast<float>(reader.number("eta", 1.5, 0.1, 100.0));
    if (refracts && parameters.eta == 1.0f) parameters.eta = 1.001f;  // equal indices have no half vector
  } else {
    auto specular = static_cast<float>(reader.number("specular", 0.5, 0.0, 1.0));
    if (refracts && specular == 0.0f) specular = 1e-3f;
    parameters.eta = 2.0f / (1.0f - std::sqrt(0.08f * specular)) - 1.0f;
  }
  const auto rate = [&](std::string_view name) {
    return static_cast<float>(reader.number(name, 1.0, 0.0, largest_rate));
  };
  parameters.specular_rate = rate("main_specular_sampling_rate");
  parameters.clearcoat_rate = rate("clearcoat_sampling_rate");
  parameters.diffuse_rate = rate("diffuse_reflectance_sampling_rate");
  return std::make_shared<Principled>(std::move(parameters));
}

}  // namespace fogbank::transport
