// The size that an OpenEXR file claims, read without the library that would act on it.
#pragma once

#include <cstdint>
#include <string>

namespace fogbank::scene {

struct ExrSize {
  bool is_valid = false;  ///< the header has a well-formed data window, and tiles of a positive size if any
  int64_t x = 0;          ///< of the data window
  int64_t y = 0;
  int64_t width = 0;
  int64_t height = 0;
  int64_t tile_width = -1;  ///< -1 for an image of scan lines
  int64_t tile_height = -1;
};

/// Reads the attributes of the first part ("OpenEXR File Layout", openexr.com).
ExrSize read_exr_size(const std::string& bytes);

}  // namespace fogbank::scene
