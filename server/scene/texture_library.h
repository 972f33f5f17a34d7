// Images of a scene, read once and kept by content.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "scene/description.h"
#include "scene/file_source.h"
#include "scene/texture.h"

namespace fogbank::scene {

/// Image with linear float data, row 0 on top. 1 or 3 channels (alpha is dropped).
struct Image {
  int32_t width = 0;
  int32_t height = 0;
  int32_t channels = 0;
  std::vector<float> data;  ///< height * width * channels

  Spectrum texel(int32_t x, int32_t y) const {
    const float* p =
        data.data() + (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) *
                          static_cast<size_t>(channels);
    return channels == 1 ? Spectrum(p[0]) : Spectrum(p[0], p[1], p[2]);
  }
};
using ImagePointer = std::shared_ptr<const Image>;

/// Builds textures from descriptions and images from files; shares both. Not thread-safe while loading,
/// immutable later.
class TextureLibrary {
 public:
  explicit TextureLibrary(std::shared_ptr<FileSource> files);

  /// Throws SceneError for an unknown plugin (naming the supported ones), a missing or damaged file, or one
  /// over the size limits (checked against the header before anything is allocated).
  TexturePointer texture(const ObjectPointer& description);
  /// `raw`: no sRGB decoding. 8-bit images are sRGB unless raw, float images linear.
  ImagePointer image(const std::string& path, bool raw, const SourceLocation& where);
  double seconds() const { return seconds_; }

 private:
  std::shared_ptr<FileSource> files_;
  std::map<const ObjectDescription*, std::pair<ObjectPointer, TexturePointer>> textures_;
  std::map<std::pair<std::string, bool>, ImagePointer> images_;
  double seconds_ = 0;
};

}  // namespace fogbank::scene
