// `blendbsdf`: linear blend of two BSDFs, (1 - weight) first + weight second.
//
// weight    number or texture in [0, 1]; required
// (nested)  two <bsdf>
//
// Throws MISSING_PARAMETER without a weight.
//
// A Dirac lobe keeps its own measure: its weight is the nested one's whatever the other BSDF is.
// Mitsuba 3.9.1 adds its probability to the densities of the smooth lobes and so loses light (diffuse 0.5 and
// a mirror at weight 0.3: albedo 0.59 instead of 0.65); blends of smooth BSDFs are the same there and here.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/parameters.h"

namespace fogbank::transport {

namespace {

class Blend final : public Bsdf {
 public:
  Blend(NumberParameter weight, BsdfPointer first, BsdfPointer second)
      : weight_(std::move(weight)), first_(std::move(first)), second_(std::move(second)) {}

  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const override {
    const float weight = weight_at(point);
    const BsdfValue first = first_->evaluate_with_pdf(point, wo, wi);
    const BsdfValue second = second_->evaluate_with_pdf(point, wo, wi);
    return {first.value * (1.0f - weight) + second.value * weight,
            first.pdf * (1.0f - weight) + second.pdf * weight};
  }

  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const override {
    const float weight = weight_at(point);
    const bool is_second = lobe < weight;
    const float probability = is_second ? weight : 1.0f - weight;
    const float rescaled = std::fmin((is_second ? lobe : lobe - weight) / probability, one_minus_epsilon);
    std::optional<BsdfSample> sample = (is_second ? second_ : first_)->sample(point, wo, rescaled, direction);
    if (!sample) return sample;
    if (sample->delta) {
      sample->pdf *= probability;  // cancels against the blend's weight in the sample's
      return sample;
    }
    const BsdfValue blended = evaluate_with_pdf(point, wo, sample->wi);
    if (!(blended.pdf > 0.0f)) return std::nullopt;
    sample->pdf = blended.pdf;
    sample->weight = blended.value / blended.pdf;
    return sample;
  }

  Spectrum null_transmission(const ShadingPoint& point, const Vec3f& wo) const override {
    const float weight = weight_at(point);
    return (1.0f - weight) * first_->null_transmission(point, wo) +
           weight * second_->null_transmission(point, wo);
  }
  bool transmits() const override { return first_->transmits() || second_->transmits(); }
  bool has_smooth_lobes() const override { return first_->has_smooth_lobes() || second_->has_smooth_lobes(); }
  Spectrum albedo_estimate() const override {
    return (1.0f - weight_.mean()) * first_->albedo_estimate() + weight_.mean() * second_->albedo_estimate();
  }

 private:
  // A texture's interpolation may leave its range by a rounding.
  float weight_at(const ShadingPoint& point) const { return glm::clamp(weight_(point), 0.0f, 1.0f); }

  NumberParameter weight_;
  BsdfPointer first_;
  BsdfPointer second_;
};

}  // namespace

BsdfPointer make_blend(scene::PropertyReader& reader, BsdfBuilder& builder) {
  if (!reader.has("weight")) reader.fail("MISSING_PARAMETER", "needs a 'weight'");
  NumberParameter weight = read_number(reader, builder, "weight", 0.5f, 0.0f, 1.0f);
  const std::vector<BsdfPointer> nested = read_nested(reader, builder, 2, 2);
  return std::make_shared<Blend>(std::move(weight), nested[0], nested[1]);
}

}  // namespace fogbank::transport
