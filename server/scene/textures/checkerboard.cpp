#include <algorithm>
#include <cmath>

#include "scene/textures/plugins.h"

namespace fogbank::scene {

namespace {

/// Colours may be textures themselves.
class CheckerboardTexture final : public Texture {
 public:
  CheckerboardTexture(TexturePointer color0, TexturePointer color1, const Mat4d& to_uv)
      : color0_(std::move(color0)),
        color1_(std::move(color1)),
        to_uv_(to_uv),
        mean_(0.5f * (color0_->mean() + color1_->mean())),
        minimum_(std::min(color0_->minimum(), color1_->minimum())),
        maximum_(std::max(color0_->maximum(), color1_->maximum())) {}

  Spectrum evaluate(const Vec2f& uv) const override {
    return is_first(uv) ? color0_->evaluate(uv) : color1_->evaluate(uv);
  }
  // Mitsuba 3.9.1 exchanges the fields where it wants a number (roughness, weight, opacity), and scenes are
  // made to look right in it.
  float evaluate_scalar(const Vec2f& uv) const override {
    return is_first(uv) ? color1_->evaluate_scalar(uv) : color0_->evaluate_scalar(uv);
  }
  Vec2f evaluate_scalar_gradient(const Vec2f& uv) const override {
    return is_first(uv) ? color1_->evaluate_scalar_gradient(uv) : color0_->evaluate_scalar_gradient(uv);
  }
  Spectrum mean() const override { return mean_; }
  float minimum() const override { return minimum_; }
  float maximum() const override { return maximum_; }

 private:
  bool is_first(const Vec2f& uv) const {
    const Vec2f at = to_uv_.apply(uv);
    const bool right = at.x - std::floor(at.x) > 0.5f;
    const bool upper = at.y - std::floor(at.y) > 0.5f;
    return right == upper;
  }

  TexturePointer color0_;
  TexturePointer color1_;
  UvTransform to_uv_;
  // Kept, since asking nested checkerboards each time would take time exponential in their depth.
  Spectrum mean_;
  float minimum_;
  float maximum_;
};

}  // namespace

TexturePointer make_checkerboard_texture(PropertyReader& reader, TextureLibrary& library) {
  const auto color = [&](const char* name, float fallback) {
    constexpr float largest = 1e30f;  // what a colour may be depends on where the checkerboard is used
    return read_texture(reader, name, Spectrum(fallback), 0.0f, largest, library);
  };
  TexturePointer color0 = color("color0", 0.4f);
  TexturePointer color1 = color("color1", 0.2f);
  return std::make_shared<CheckerboardTexture>(std::move(color0), std::move(color1),
                                               reader.transform("to_uv"));
}

}  // namespace fogbank::scene
