// Reading back a final image that `encode_image` made.
#pragma once

#include <string>
#include <vector>

#include "scene/sensor.h"

namespace fogbank::render {

/// Channels R, G, B of an EXR file as height * width * 3 floats, exactly as stored. Throws Error(data_loss,
/// "EXR_DECODING") when it is damaged or its data window is not `window`; that is checked against the header,
/// before memory is spent.
std::vector<float> decode_rgb(const std::string& file, const scene::Window& window);

}  // namespace fogbank::render
