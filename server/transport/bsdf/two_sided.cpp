// `twosided`: gives reflecting BSDFs a back.
//
// (nested)            one <bsdf> for both sides, or two: front and back
// allow_transmission  boolean, default false: accept nested BSDFs that let light through, each then seen as
//                     from outside from either side
//
// Throws TRANSMITTING_BSDF for a nested BSDF that lets light through, unless allowed.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"

namespace fogbank::transport {

namespace {

Vec3f flip(const Vec3f& w) { return {w.x, w.y, -w.z}; }

class TwoSided final : public Bsdf {
 public:
  TwoSided(BsdfPointer front, BsdfPointer back) : front_(std::move(front)), back_(std::move(back)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    return wo.z >= 0.0f ? front_->evaluate_with_pdf(point, wo, wi)
                        : back_->evaluate_with_pdf(point, flip(wo), flip(wi));
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    if (wo.z >= 0.0f) return front_->sample(point, wo, lobe, direction);
    std::optional<BsdfSample> sample = back_->sample(point, flip(wo), lobe, direction);
    if (sample) sample->wi = flip(sample->wi);
    return sample;
  }

  Spectrum null_transmission(const ShadingPoint& point, const Vec3f& wo) const override {
    return wo.z >= 0.0f ? front_->null_transmission(point, wo) : back_->null_transmission(point, flip(wo));
  }
  std::optional<Spectrum> lambertian_reflectance(const ShadingPoint& point, const Vec3f& wo) const override {
    return wo.z >= 0.0f ? front_->lambertian_reflectance(point, wo)
                        : back_->lambertian_reflectance(point, flip(wo));
  }
  bool transmits() const override { return front_->transmits() || back_->transmits(); }
  bool has_smooth_lobes() const override { return front_->has_smooth_lobes() || back_->has_smooth_lobes(); }
  Spectrum albedo_estimate() const override {
    return 0.5f * (front_->albedo_estimate() + back_->albedo_estimate());
  }

 private:
  BsdfPointer front_;
  BsdfPointer back_;
};

}  // namespace

BsdfPointer make_two_sided(scene::PropertyReader& reader, BsdfBuilder& builder) {
  const std::vector<BsdfPointer> nested = read_nested(reader, builder, 1, 2);
  const bool allow_transmission = reader.boolean("allow_transmission", false);
  for (const BsdfPointer& bsdf : nested)
    if (!allow_transmission && bsdf->transmits())
      reader.fail("TRANSMITTING_BSDF",
                  "only BSDFs that let no light through can be nested (allow_transmission=true overrides)");
  return std::make_shared<TwoSided>(nested.front(), nested.back());
}

}  // namespace fogbank::transport
