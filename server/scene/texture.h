// Textures: reflectances and other parameters that vary over a surface.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/vector.h"
#include "scene/description.h"

namespace fogbank::scene {

class TextureLibrary;

/// Immutable and safe to evaluate from any thread. Values are linear sRGB (bitmaps marked `raw` are taken as
/// they are).
class Texture {
 public:
  virtual ~Texture() = default;
  /// uv as the shape gives it; wraps as the texture says.
  virtual Spectrum evaluate(const Vec2f& uv) const = 0;
  /// One channel: the luminance, of raw data too (as Mitsuba 3.9.1's `eval_1`).
  virtual float evaluate_scalar(const Vec2f& uv) const { return luminance(evaluate(uv)); }
  /// d evaluate_scalar / d(u, v); bump maps need it. Zero where the texture is constant piece by piece.
  virtual Vec2f evaluate_scalar_gradient(const Vec2f& uv) const = 0;
  /// Mean over one period; exact for constants.
  virtual Spectrum mean() const = 0;
  /// Smallest and largest channel value anywhere (range checks, sampling weights).
  virtual float minimum() const = 0;
  virtual float maximum() const = 0;
  virtual bool is_constant() const { return false; }
};
using TexturePointer = std::shared_ptr<const Texture>;

TexturePointer constant_texture(const Spectrum& value);

/// Texture named `name` of an object: a number, a colour or a nested `<texture>`; each value must lie in
/// [lowest, highest], those of images too. Nested textures are built once per description and shared.
TexturePointer read_texture(PropertyReader& reader, std::string_view name, const Spectrum& fallback,
                            float lowest, float highest, TextureLibrary& library);

}  // namespace fogbank::scene
