// `mask`: opacity, e.g. of leaves. Where it isn't opaque, light goes straight on as through `null`.
//
// opacity   number or texture in [0, 1], default 0.5; 1 is opaque
// (nested)  one <bsdf>: the opaque part
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"

namespace fogbank::transport {

namespace {

class Mask final : public Bsdf {
 public:
  Mask(NumberParameter opacity, BsdfPointer nested)
      : opacity_(std::move(opacity)), nested_(std::move(nested)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    const float opacity = opacity_at(point);
    const BsdfValue nested = nested_->evaluate_with_pdf(point, wo, wi);
    return {nested.value * opacity, nested.pdf * opacity};
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    const float opacity = opacity_at(point);
    if (lobe < opacity) {
      std::optional<BsdfSample> sample =
          nested_->sample(point, wo, std::fmin(lobe / opacity, one_minus_epsilon), direction);
      if (sample) sample->pdf *= opacity;
      return sample;
    }
    BsdfSample sample;
    sample.wi = -wo;
    sample.weight = Spectrum(1);
    sample.pdf = 1.0f - opacity;
    sample.delta = true;
    sample.null = true;
    return sample;
  }

  Spectrum null_transmission(const ShadingPoint& point, const Vec3f& wo) const override {
    const float opacity = opacity_at(point);
    return Spectrum(1.0f - opacity) + opacity * nested_->null_transmission(point, wo);
  }
  bool transmits() const override { return true; }
  bool has_smooth_lobes() const override { return nested_->has_smooth_lobes(); }
  Spectrum albedo_estimate() const override {
    return Spectrum(1.0f - opacity_.mean()) + opacity_.mean() * nested_->albedo_estimate();
  }

 private:
  // A texture's interpolation may leave its range by a rounding.
  float opacity_at(const ShadingPoint& point) const { return glm::clamp(opacity_(point), 0.0f, 1.0f); }

  NumberParameter opacity_;
  BsdfPointer nested_;
};

}  // namespace

BsdfPointer make_mask(scene::PropertyReader& reader, BsdfBuilder& builder) {
  NumberParameter opacity = read_number(reader, builder, "opacity", 0.5f, 0.0f, 1.0f);
  return std::make_shared<Mask>(std::move(opacity), read_nested(reader, builder, 1, 1).front());
}

}  // namespace fogbank::transport
