// `null`: an invisible boundary that light passes unchanged, e.g. of a medium. No parameters.
#include "transport/bsdf/factories.h"

namespace fogbank::transport {

namespace {

class Null final : public Bsdf {
 public:
  BsdfValue evaluate_with_pdf(const ShadingPoint&, const Vec3f&, const Vec3f&) const override { return {}; }

  std::optional<BsdfSample> sample(const ShadingPoint&, const Vec3f& wo, float, const Vec2f&) const override {
    BsdfSample sample;
    sample.wi = -wo;
    sample.weight = Spectrum(1);
    sample.pdf = 1;
    sample.delta = true;
    sample.null = true;
    return sample;
  }

  Spectrum null_transmission(const ShadingPoint&, const Vec3f&) const override { return Spectrum(1); }
  bool transmits() const override { return true; }
  bool has_smooth_lobes() const override { return false; }
  Spectrum albedo_estimate() const override { return Spectrum(1); }
};

}  // namespace

BsdfPointer make_null(scene::PropertyReader&, BsdfBuilder&) { return std::make_shared<Null>(); }

}  // namespace fogbank::transport
