// The header of a PLY file (Turk 1994, "The PLY Polygon File Format").
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "scene/mesh_reader_support.h"

namespace fogbank::scene {

enum class PlyType : uint8_t { int8, uint8, int16, uint16, int32, uint32, float32, float64 };
enum class PlyEncoding : uint8_t { ascii, little_endian, big_endian };

/// Bytes of one value in a binary file.
size_t byte_size(PlyType type);

struct PlyProperty {
  std::string name;
  PlyType type = PlyType::float32;
  bool is_list = false;
  PlyType count_type = PlyType::uint8;  ///< lists only

  /// Bytes in a binary file: exact for scalars, the least possible for lists.
  size_t least_bytes() const { return byte_size(is_list ? count_type : type); }
};

struct PlyElement {
  std::string name;
  uint64_t count = 0;
  std::vector<PlyProperty> properties;

  /// Position of the property called one of `names`, or -1.
  int find(std::initializer_list<std::string_view> names) const;
};

struct PlyHeader {
  PlyEncoding encoding = PlyEncoding::ascii;
  std::vector<PlyElement> elements;
  size_t data_offset = 0;  ///< byte after the header
  size_t data_line = 0;    ///< its line, from 1
};

/// Throws DAMAGED_MESH naming the line. Counts are checked against the rest of the file: each element needs
/// its least size, so nothing later allocates more than the file can fill.
PlyHeader read_ply_header(const std::string& bytes, const MeshFile& file);

}  // namespace fogbank::scene
