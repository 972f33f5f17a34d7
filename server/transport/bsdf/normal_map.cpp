// `normalmap`: shading normals from a texture.
//
// normalmap                colour texture, required: (n + 1) / 2 of the normal in the shading frame, whose
//                          tangent lies along dp/du; bitmaps should be `raw`
// flip_invalid_normals     boolean, default true;  see perturbed.h
// use_shadowing_function   boolean, default true;  see perturbed.h
// (nested)                 one <bsdf>
//
// Throws MISSING_PARAMETER without a map.
#include "transport/bsdf/factories.h"
#include "transport/bsdf/perturbed.h"

namespace fogbank::transport {

namespace {

class NormalMap final : public PerturbedBsdf {
 public:
  NormalMap(scene::PropertyReader& reader, BsdfBuilder& builder)
      : PerturbedBsdf(reader, builder),
        map_(scene::read_texture(reader, "normalmap", Spectrum(0.5f, 0.5f, 1.0f), 0.0f, 1.0f,
                                 builder.textures())) {}

 private:
  Vec3f normal(const ShadingPoint& point) const override {
    return 2.0f * map_->evaluate(point.uv) - Vec3f(1);
  }

  scene::TexturePointer map_;
};

}  // namespace

BsdfPointer make_normal_map(scene::PropertyReader& reader, BsdfBuilder& builder) {
  if (!reader.has("normalmap")) reader.fail("MISSING_PARAMETER", "needs a texture 'normalmap'");
  return std::make_shared<NormalMap>(reader, builder);
}

}  // namespace fogbank::transport
