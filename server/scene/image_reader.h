// Image files to `Image`.
#pragma once

#include <array>
#include <string>

#include "scene/texture_library.h"

namespace fogbank::scene {

/// Reads an image from a file's bytes: OpenEXR, PNG, JPEG, Radiance HDR, TIFF, BMP or Targa, told apart by
/// content (Targa, which has no mark, by the ending of `path`). `raw`: no sRGB decoding of integer data. Of
/// an image with more channels, R, G and B are taken (Y of an EXR without these, the first of two). Throws
/// SceneError: UNSUPPORTED_IMAGE, DAMAGED_IMAGE (broken or cut off, or a texel that is not finite; names the
/// texel), IMAGE_TOO_LARGE (resource_exhausted, decided on the header alone).
Image read_image(const std::string& bytes, const std::string& path, bool raw, const SourceLocation& where);

/// Value of each byte of an image of 8 bits. Static.
const std::array<float, 256>* byte_decoding(bool raw);

}  // namespace fogbank::scene
