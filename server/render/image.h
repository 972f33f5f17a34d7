// Pictures that a rendering job gives away.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "scene/sensor.h"

namespace fogbank::render {

/// A tile as it is now: mean radiance over all finished samples of each pixel.
struct TilePixels {
  scene::Window window;
  uint32_t pass = 0;       ///< number of passes in it
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< height * width * 3; finite, no denormals
};

/// One more number per pixel.
struct ImageChannel {
  std::string name;
  std::vector<float> values;  ///< height * width; finite, no denormals
};

/// Whole image over finished passes.
struct Image {
  scene::Window window;    ///< data window: the crop
  int32_t full_width = 0;  ///< display window
  int32_t full_height = 0;
  uint32_t samples = 0;    ///< per pixel
  std::vector<float> rgb;  ///< mean, height * width * 3; finite, no denormals
  /// Estimated variance of `rgb`, same shape, from the two half buffers (film.h); 0 with one sample. One
  /// degree of freedom a pixel: right on average, rough for any one pixel.
  std::vector<float> variance;
  std::vector<ImageChannel> aovs;  ///< as RenderSettings::aovs, once the job is finished; empty before
};

}  // namespace fogbank::render
