#include "scene/texture.h"

#include <sstream>

#include "scene/texture_library.h"

namespace fogbank::scene {

namespace {

class ConstantTexture final : public Texture {
 public:
  explicit ConstantTexture(const Spectrum& value) : value_(value) {}

  Spectrum evaluate(const Vec2f&) const override { return value_; }
  Vec2f evaluate_scalar_gradient(const Vec2f&) const override { return Vec2f(0); }
  Spectrum mean() const override { return value_; }
  float minimum() const override { return min_component(value_); }
  float maximum() const override { return max_component(value_); }
  bool is_constant() const override { return true; }

 private:
  Spectrum value_;
};

}  // namespace

TexturePointer constant_texture(const Spectrum& value) { return std::make_shared<ConstantTexture>(value); }

TexturePointer read_texture(PropertyReader& reader, std::string_view name, const Spectrum& fallback,
                            float lowest, float highest, TextureLibrary& library) {
  const PropertyValue* value = reader.raw(name);
  if (value == nullptr || !std::holds_alternative<ObjectPointer>(*value))
    return constant_texture(reader.spectrum(name, fallback, lowest, highest));
  TexturePointer texture = library.texture(reader.child(name, "texture"));
  if (texture->minimum() < lowest || texture->maximum() > highest) {
    std::ostringstream message;
    message << "must lie within [" << lowest << ", " << highest << "], the texture's values are within ["
            << texture->minimum() << ", " << texture->maximum() << "]";
    reader.fail_at(name, "OUT_OF_RANGE", message.str());
  }
  return texture;
}

}  // namespace fogbank::scene
