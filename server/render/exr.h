// OpenEXR encoding in memory, through OpenImageIO.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "render/render_job.h"

namespace fogbank::render {

enum class PixelType : uint8_t { half_float, single_float };
enum class Compression : uint8_t { none, zip };

/// Header attributes, name -> text ("fogbank:scene", "fogbank:settings", ...).
using Provenance = std::map<std::string, std::string>;

/// One tile as an EXR file: data window = the tile's window, display window = the whole film. Values over the
/// half range are clamped to it. Channels R, G, B.
std::string encode_tile(const TilePixels& tile, int32_t full_width, int32_t full_height, PixelType type,
                        Compression compression);

/// The final image; with `variance` also channels variance.R, variance.G, variance.B.
std::string encode_image(const Image& image, PixelType type, bool variance, const Provenance& provenance);

}  // namespace fogbank::render
