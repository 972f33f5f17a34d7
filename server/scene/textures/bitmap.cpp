#include <algorithm>
#include <cmath>

#include "scene/textures/plugins.h"

namespace fogbank::scene {

namespace {

enum class Filter : uint8_t { bilinear, nearest };
enum class Wrap : uint8_t { repeat, mirror, clamp };

/// Texel index for any integer index.
int32_t wrap_index(int32_t index, int32_t size, Wrap wrap) {
  if (index >= 0 && index < size) return index;
  if (wrap == Wrap::clamp) return std::clamp(index, 0, size - 1);
  const int32_t period = wrap == Wrap::mirror ? 2 * size : size;
  const int32_t within = ((index % period) + period) % period;
  return within < size ? within : period - 1 - within;
}

/// Coordinate brought near the unit square first, so that large ones neither overflow an index nor lose their
/// fraction to the multiplication. What is not finite becomes 0.
float reduce(float coordinate, Wrap wrap) {
  if (!std::isfinite(coordinate)) return 0.0f;
  switch (wrap) {
    case Wrap::repeat:
      return coordinate - std::floor(coordinate);
    case Wrap::mirror:
      return coordinate - 2.0f * std::floor(0.5f * coordinate);
    default:
      return std::clamp(coordinate, -1.0f, 2.0f);
  }
}

class BitmapTexture final : public Texture {
 public:
  BitmapTexture(ImagePointer image, Filter filter, Wrap wrap, const Mat4d& to_uv)
      : image_(std::move(image)), to_uv_(to_uv), filter_(filter), wrap_(wrap) {
    Vec3d sum(0);
    for (int32_t y = 0; y < image_->height; ++y) {
      Vec3d row(0);
      for (int32_t x = 0; x < image_->width; ++x) row += Vec3d(image_->texel(x, y));
      sum += row;
    }
    mean_ = Spectrum(sum / (static_cast<double>(image_->width) * static_cast<double>(image_->height)));
  }

  Spectrum evaluate(const Vec2f& uv) const override {
    const Vec2f position = texel_position(uv);
    if (filter_ == Filter::nearest)
      return texel(static_cast<int32_t>(std::floor(position.x)),
                   static_cast<int32_t>(std::floor(position.y)));
    const Footprint f = footprint(position);
    return (1 - f.t.y) * ((1 - f.t.x) * f.c00 + f.t.x * f.c10) +
           f.t.y * ((1 - f.t.x) * f.c01 + f.t.x * f.c11);
  }

  /// The exact derivative of the bilinear surface. Mitsuba 3.9.1 agrees, except that under a rotating `to_uv`
  /// it applies the matrix where the chain rule has its transpose.
  Vec2f evaluate_scalar_gradient(const Vec2f& uv) const override {
    if (filter_ == Filter::nearest) return Vec2f(0);
    const Footprint f = footprint(texel_position(uv));
    const float l00 = luminance(f.c00);
    const float l10 = luminance(f.c10);
    const float l01 = luminance(f.c01);
    const float l11 = luminance(f.c11);
    const float along_x = (1 - f.t.y) * (l10 - l00) + f.t.y * (l11 - l01);
    const float along_y = (1 - f.t.x) * (l01 - l00) + f.t.x * (l11 - l10);
    return to_uv_.pull_back_gradient(
        {along_x * static_cast<float>(image_->width), along_y * static_cast<float>(image_->height)});
  }

  Spectrum mean() const override { return mean_; }
  float minimum() const override { return image_->lowest; }
  float maximum() const override { return image_->highest; }

 private:
  /// The four texels around a position, and where between them it lies.
  struct Footprint {
    Spectrum c00, c10, c01, c11;
    Vec2f t;
  };

  /// In texels; texel centres are at half-integers.
  Vec2f texel_position(const Vec2f& uv) const {
    const Vec2f at = to_uv_.apply(uv);
    return {reduce(at.x, wrap_) * static_cast<float>(image_->width),
            reduce(at.y, wrap_) * static_cast<float>(image_->height)};
  }

  Spectrum texel(int32_t x, int32_t y) const {
    return image_->texel(wrap_index(x, image_->width, wrap_), wrap_index(y, image_->height, wrap_));
  }

  Footprint footprint(const Vec2f& position) const {
    const float x = position.x - 0.5f;
    const float y = position.y - 0.5f;
    const auto column = static_cast<int32_t>(std::floor(x));
    const auto row = static_cast<int32_t>(std::floor(y));
    return {texel(column, row),
            texel(column + 1, row),
            texel(column, row + 1),
            texel(column + 1, row + 1),
            {x - static_cast<float>(column), y - static_cast<float>(row)}};
  }

  ImagePointer image_;
  UvTransform to_uv_;
  Spectrum mean_{0};
  Filter filter_;
  Wrap wrap_;
};

}  // namespace

TexturePointer make_bitmap_texture(PropertyReader& reader, TextureLibrary& library) {
  if (!reader.has("filename")) reader.fail("MISSING_PARAMETER", "parameter 'filename' is missing");
  const std::string path = reader.text("filename", "");
  const Filter filter = reader.choice("filter_type", "bilinear", {"bilinear", "nearest"}) == "nearest"
                            ? Filter::nearest
                            : Filter::bilinear;
  const std::string wrap_mode = reader.choice("wrap_mode", "repeat", {"repeat", "mirror", "clamp"});
  const Wrap wrap = wrap_mode == "clamp" ? Wrap::clamp : wrap_mode == "mirror" ? Wrap::mirror : Wrap::repeat;
  const bool raw = reader.boolean("raw", false);
  // How Mitsuba stores and looks up texels; neither changes a value beyond rounding.
  reader.choice("format", "variant", {"variant", "fp16", "auto"});
  reader.boolean("accel", true);
  return std::make_shared<BitmapTexture>(library.image(path, raw, reader.object().where), filter, wrap,
                                         reader.transform("to_uv"));
}

}  // namespace fogbank::scene
