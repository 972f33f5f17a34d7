// Parameters that may be textures, with constants kept inline: most are constant, and then a BSDF costs no
// virtual call.
#pragma once

#include "scene/texture.h"
#include "transport/bsdf.h"

namespace fogbank::transport {

/// A colour that may vary over the surface.
class ColorParameter {
 public:
  explicit ColorParameter(scene::TexturePointer texture)
      : texture_(std::move(texture)), constant_(texture_->mean()), varies_(!texture_->is_constant()) {}

  Spectrum operator()(const ShadingPoint& point) const {
    return varies_ ? texture_->evaluate(point.uv) : constant_;
  }
  Spectrum mean() const { return constant_; }

 private:
  scene::TexturePointer texture_;
  Spectrum constant_;  ///< the mean where it varies
  bool varies_;
};

/// A number that may vary over the surface.
class NumberParameter {
 public:
  explicit NumberParameter(scene::TexturePointer texture)
      : texture_(std::move(texture)), varies_(!texture_->is_constant()) {
    // A constant is equal in every channel or a colour; only the latter needs weighting, which would round.
    const Spectrum value = texture_->mean();
    constant_ = value.x == value.y && value.y == value.z ? value.x : luminance(value);
  }

  float operator()(const ShadingPoint& point) const {
    return varies_ ? texture_->evaluate_scalar(point.uv) : constant_;
  }
  float mean() const { return constant_; }
  bool varies() const { return varies_; }

 private:
  scene::TexturePointer texture_;
  float constant_ = 0;  ///< the mean where it varies
  bool varies_;
};

}  // namespace fogbank::transport
