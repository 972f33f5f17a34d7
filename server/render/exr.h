// OpenEXR encoding in memory, through OpenImageIO.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "render/image.h"
#include "render/progress.h"
#include "render/render_settings.h"

namespace fogbank::render {

enum class PixelType : uint8_t { half_float, single_float };
enum class Compression : uint8_t { none, zip };

/// Header attributes, name -> text ("fogbank:scene", "fogbank:settings", ...).
using Provenance = std::map<std::string, std::string>;

/// What every final image says about its making: "fogbank:version", "fogbank:scene" (fingerprint),
/// "fogbank:integrator", "fogbank:settings" (JSON), "fogbank:seed", "fogbank:samples_per_pixel",
/// "fogbank:samples", "fogbank:rays", "fogbank:render_seconds", "fogbank:render_cpu_seconds", "fogbank:cache"
/// and "fogbank:error" (JSON, as Progress), "fogbank:history" (JSON, a list of HistoryEntry; what is not
/// known is left out). Neither host names nor paths.
Provenance describe(const RenderSettings& settings, const Progress& progress,
                    const std::vector<HistoryEntry>& history, const std::string& scene_fingerprint);

/// Uncompressed up to 128 KiB of pixels, as compressing costs ten times the encoding; zip above it.
Compression tile_compression(const scene::Window& window, PixelType type);

/// One tile as an EXR file: data window = the tile's window, display window = the whole film. Channels R, G,
/// B, linear sRGB. Values over the half range are clamped to it. Below 256 KiB for every tile that `validate`
/// lets pass. Throws Error(internal, "NON_FINITE_PIXEL" / "EXR_ENCODING").
std::string encode_tile(const TilePixels& tile, int32_t full_width, int32_t full_height, PixelType type,
                        Compression compression);

/// The final image, zip; with `variance` also channels variance.R, variance.G, variance.B; AOVs come last.
/// Errors as `encode_tile`.
std::string encode_image(const Image& image, PixelType type, bool variance, const Provenance& provenance);

}  // namespace fogbank::render
