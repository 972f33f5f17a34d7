// A BSDF seen in a tilted shading frame: what bump and normal maps share.
#pragma once

#include "transport/bsdf.h"

namespace fogbank::transport {

/// Evaluates and samples `nested` in the frame that `normal` gives. Two remedies for what tilted normals
/// break: `flip_invalid_normals` mirrors the tilt where the viewer would see the facet's back (Schuessler et
/// al. 2017, "Microfacet-based Normal Mapping for Robust Monte Carlo Path Tracing"), `use_shadowing_function`
/// darkens light that comes in at a grazing angle, which otherwise ends at a hard terminator (Estevez et al.
/// 2019, "A Microfacet-Based Shadowing Function to Solve the Bump Terminator Problem", eqs. 3 and 4; it
/// breaks reciprocity).
class PerturbedBsdf : public Bsdf {
 public:
  BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const final;
  std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                   const Vec2f& direction) const final;
  Spectrum null_transmission(const ShadingPoint& point, const Vec3f& wo) const final;
  bool transmits() const final { return nested_->transmits(); }
  bool has_smooth_lobes() const final { return nested_->has_smooth_lobes(); }
  Spectrum albedo_estimate() const final { return nested_->albedo_estimate(); }

 protected:
  /// Reads `flip_invalid_normals`, `use_shadowing_function` (booleans, default true) and the nested <bsdf>.
  PerturbedBsdf(scene::PropertyReader& reader, BsdfBuilder& builder);

  /// The map's normal in the shading frame of `point`, in any length; zero or not finite means no tilt.
  virtual Vec3f normal(const ShadingPoint& point) const = 0;

 private:
  /// Tilted frame in the coordinates of the shading frame.
  Frame tilted_frame(const ShadingPoint& point, const Vec3f& wo) const;
  float shadowing(const Vec3f& normal, const Vec3f& wi) const;

  BsdfPointer nested_;
  bool flip_invalid_normals_;
  bool use_shadowing_function_;
};

}  // namespace fogbank::transport
