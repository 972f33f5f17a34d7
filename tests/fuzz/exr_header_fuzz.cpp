// The check of OpenEXR headers that stands before OpenEXR itself.
#include "fuzz.h"
#include "scene/exr_header.h"

using namespace fogbank;

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const scene::ExrSize found = scene::read_exr_size(fuzz::bytes_of(data, size));
  fuzz::require(!found.is_valid || found.tile_width == -1 || (found.tile_width > 0 && found.tile_height > 0),
                "tiles have a size");
  return 0;
}
