#include "scene/textures/plugins.h"

namespace fogbank::scene {

namespace {

class ScaleTexture final : public Texture {
 public:
  ScaleTexture(TexturePointer nested, const Spectrum& factor) : nested_(std::move(nested)), factor_(factor) {}

  Spectrum evaluate(const Vec2f& uv) const override { return factor_ * nested_->evaluate(uv); }
  Vec2f evaluate_scalar_gradient(const Vec2f& uv) const override {
    // Exact for a grey factor or a grey texture; a coloured factor weights the luminance's channels
    // differently, which the nested texture's scalar does not tell apart.
    return luminance(factor_) * nested_->evaluate_scalar_gradient(uv);
  }
  Spectrum mean() const override { return factor_ * nested_->mean(); }
  float minimum() const override { return min_component(factor_) * nested_->minimum(); }
  float maximum() const override { return max_component(factor_) * nested_->maximum(); }
  bool is_constant() const override { return nested_->is_constant(); }

 private:
  TexturePointer nested_;
  Spectrum factor_;
};

}  // namespace

TexturePointer make_scale_texture(PropertyReader& reader, TextureLibrary& library) {
  const std::vector<ObjectPointer> nested = reader.children("texture");
  if (nested.size() != 1)
    reader.fail("MISSING_PARAMETER", "needs 1 nested <texture>, has " + std::to_string(nested.size()));
  constexpr float largest = 1e30f;
  return std::make_shared<ScaleTexture>(library.texture(nested.front()),
                                        reader.spectrum("scale", Spectrum(1), 0.0f, largest));
}

}  // namespace fogbank::scene
