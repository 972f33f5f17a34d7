// Image files made in memory with OpenImageIO.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace fogbank::scene::test {

/// File of OpenImageIO's format `format` ("png", "openexr", ...) with `values` (row by row, channels
/// interleaved) stored as their type: uint8_t, uint16_t or float. Named channels are for OpenEXR.
template <class Value>
std::string image_file(const std::string& format, int width, int height, const std::vector<Value>& values,
                       const std::vector<std::string>& channel_names = {});

/// 4 x 3 grey texels, 8 bits.
inline const std::vector<uint8_t> grid = {10, 60, 110, 160, 210, 250, 200, 150, 100, 50, 0, 255};

}  // namespace fogbank::scene::test
