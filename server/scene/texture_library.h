// Images of a scene, read once and kept by content.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/texture.h"

namespace fogbank::scene {

class SceneFileReader;

/// Image of linear values, row 0 on top. 1 or 3 channels (alpha is dropped, not multiplied in). Images of 8
/// bits stay so in memory and are decoded on reading.
struct Image {
  int32_t width = 0;
  int32_t height = 0;
  int32_t channels = 0;
  std::vector<float> data;                         ///< height * width * channels, or empty
  std::vector<uint8_t> bytes;                      ///< the same for images of 8 bits, else empty
  const std::array<float, 256>* decode = nullptr;  ///< value of each byte; static
  float lowest = 0;                                ///< smallest value of any channel
  float highest = 0;

  Spectrum texel(int32_t x, int32_t y) const {
    const size_t first = (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)) *
                         static_cast<size_t>(channels);
    if (!data.empty()) {
      const float* p = data.data() + first;
      return channels == 1 ? Spectrum(p[0]) : Spectrum(p[0], p[1], p[2]);
    }
    const uint8_t* p = bytes.data() + first;
    return channels == 1 ? Spectrum((*decode)[p[0]])
                         : Spectrum((*decode)[p[0]], (*decode)[p[1]], (*decode)[p[2]]);
  }
};
using ImagePointer = std::shared_ptr<const Image>;

/// Builds textures from descriptions and images from files; shares both. Not thread-safe while loading,
/// immutable later.
class TextureLibrary {
 public:
  /// With `warnings`, loading is lenient: an unknown plugin becomes a grey of 0.5, an unknown parameter is
  /// passed over, and each adds a warning. The list must outlive the library.
  explicit TextureLibrary(std::shared_ptr<SceneFileReader> files,
                          std::vector<std::string>* warnings = nullptr);

  /// Throws SceneError for an unknown plugin (naming the supported ones), textures nested more than 32 deep,
  /// a missing or damaged file, or one over the size limits (checked against the header before anything is
  /// allocated).
  TexturePointer texture(const ObjectPointer& description);
  /// `raw`: no sRGB decoding. Integer images (8 and 16 bits) are sRGB unless raw, float images linear. Two
  /// paths with the same content share one image.
  ImagePointer image(const std::string& path, bool raw, const SourceLocation& where);
  double seconds() const { return seconds_; }

 private:
  std::shared_ptr<SceneFileReader> files_;
  std::vector<std::string>* warnings_;
  int depth_ = 0;  ///< of nested textures being built
  std::map<const ObjectDescription*, std::pair<ObjectPointer, TexturePointer>> textures_;
  std::map<std::pair<std::string, bool>, ImagePointer> images_;  ///< by content and `raw`
  double seconds_ = 0;
};

}  // namespace fogbank::scene
