// `bumpmap`: shading normals from a height field.
//
// (nested)                 one <texture>, whatever its name: heights in units of the scene; bitmaps should be
//                          `raw`
// scale                    number, default 1: times the heights
// flip_invalid_normals     boolean, default true;  see perturbed.h
// use_shadowing_function   boolean, default true;  see perturbed.h
// (nested)                 one <bsdf>
//
// Throws WRONG_NUMBER_OF_TEXTURES unless there is exactly one texture.
//
// The displaced surface's partial derivatives, without the curvature of the surface itself (Blinn 1978,
// "Simulation of Wrinkled Surfaces", eq. 4), give its normal.
#include "scene/texture_library.h"
#include "transport/bsdf/factories.h"
#include "transport/bsdf/perturbed.h"

namespace fogbank::transport {

namespace {

class BumpMap final : public PerturbedBsdf {
 public:
  BumpMap(scene::PropertyReader& reader, BsdfBuilder& builder)
      : PerturbedBsdf(reader, builder),
        scale_(static_cast<float>(reader.number("scale", 1.0, -largest_scale, largest_scale))) {
    const std::vector<scene::ObjectPointer> textures = reader.children("texture");
    if (textures.size() != 1)
      reader.fail("WRONG_NUMBER_OF_TEXTURES",
                  "needs 1 nested <texture>, has " + std::to_string(textures.size()));
    heights_ = builder.textures().texture(textures.front());
  }

 private:
  static constexpr double largest_scale = 1e6;

  Vec3f normal(const ShadingPoint& point) const override {
    const Vec2f gradient = scale_ * heights_->evaluate_scalar_gradient(point.uv);
    // Tangents of the displaced surface in the shading frame: their part along the normal is the slope.
    const Vec3f du = point.frame.to_local(point.dp_du);
    const Vec3f dv = point.frame.to_local(point.dp_dv);
    const Vec3f n = glm::cross(Vec3f(du.x, du.y, gradient.x), Vec3f(dv.x, dv.y, gradient.y));
    // A mirrored parametrisation turns the cross product round.
    return glm::dot(point.frame.to_local(point.geometric_normal), n) < 0.0f ? -n : n;
  }

  scene::TexturePointer heights_;
  float scale_;
};

}  // namespace

BsdfPointer make_bump_map(scene::PropertyReader& reader, BsdfBuilder& builder) {
  return std::make_shared<BumpMap>(reader, builder);
}

}  // namespace fogbank::transport
