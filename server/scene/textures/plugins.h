// Constructors of the texture plugins; texture_library.cpp lists them by name.
#pragma once

#include "scene/texture.h"
#include "scene/texture_library.h"

namespace fogbank::scene {

/// `bitmap`: `filename`; `filter_type` bilinear (default) or nearest; `wrap_mode` repeat (default), mirror or
/// clamp; `raw` (default false); `to_uv`. Texels are `Image` texels, row 0 at v = 0.
TexturePointer make_bitmap_texture(PropertyReader& reader, TextureLibrary& library);

/// `checkerboard`: `color0` (default 0.4), `color1` (default 0.2); `to_uv`. Two by two fields in the unit
/// square.
TexturePointer make_checkerboard_texture(PropertyReader& reader, TextureLibrary& library);

/// `scale` (Mitsuba 0.x): the nested texture times `scale` (number or colour, not negative, default 1).
TexturePointer make_scale_texture(PropertyReader& reader, TextureLibrary& library);

/// Affine map of texture coordinates: the x and y part of `to_uv`, applied to (u, v).
class UvTransform {
 public:
  explicit UvTransform(const Mat4d& to_uv)
      : u_(static_cast<float>(to_uv[0][0]), static_cast<float>(to_uv[1][0])),
        v_(static_cast<float>(to_uv[0][1]), static_cast<float>(to_uv[1][1])),
        offset_(static_cast<float>(to_uv[3][0]), static_cast<float>(to_uv[3][1])) {}

  Vec2f apply(const Vec2f& uv) const { return Vec2f(glm::dot(u_, uv), glm::dot(v_, uv)) + offset_; }
  /// Gradient with respect to the untransformed coordinates: the transposed linear part times `g`.
  Vec2f pull_back_gradient(const Vec2f& g) const { return u_ * g.x + v_ * g.y; }

 private:
  Vec2f u_;
  Vec2f v_;
  Vec2f offset_;
};

}  // namespace fogbank::scene
