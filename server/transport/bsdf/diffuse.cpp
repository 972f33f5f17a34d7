// `diffuse`: ideal Lambertian reflection from the front side; the back is black.
//
// reflectance  colour or texture in [0, 1], default 0.5
//
// f = reflectance / pi, sampled by the cosine.
#include "core/sampling.h"
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"

namespace fogbank::transport {

namespace {

class Diffuse final : public Bsdf {
 public:
  explicit Diffuse(ColorParameter reflectance) : reflectance_(std::move(reflectance)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    if (!(wo.z > 0.0f && wi.z > 0.0f)) return {};
    const float pdf = inv_pi * wi.z;
    return {reflectance_(point) * pdf, pdf};
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float /*lobe*/,
                                   const Vec2f& direction) const override {
    if (!(wo.z > 0.0f)) return std::nullopt;
    BsdfSample sample;
    sample.wi = square_to_cosine_hemisphere(direction);
    sample.pdf = inv_pi * sample.wi.z;
    if (!(sample.pdf > 0.0f)) return std::nullopt;
    sample.weight = reflectance_(point);
    return sample;
  }

  bool has_smooth_lobes() const override { return true; }
  std::optional<Spectrum> lambertian_reflectance(const ShadingPoint& point, const Vec3f& wo) const override {
    return wo.z > 0.0f ? reflectance_(point) : Spectrum(0);
  }
  Spectrum albedo_estimate() const override { return reflectance_.mean(); }

 private:
  ColorParameter reflectance_;
};

}  // namespace

BsdfPointer make_diffuse(scene::PropertyReader& reader, BsdfBuilder& builder) {
  return std::make_shared<Diffuse>(read_reflectance(reader, builder, "reflectance", 0.5f));
}

}  // namespace fogbank::transport
