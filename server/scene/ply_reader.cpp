// PLY meshes. Debian 12 has no PLY library by itself (no miniply, happly, tinyply); Assimp reads PLY, but
// unifies and reorders what it reads, reports no place in the file, and is a large surface to hostile input.
#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>
#include <limits>
#include <string_view>

#include "scene/ply_header.h"

namespace fogbank::scene {

namespace {

static_assert(std::endian::native == std::endian::little, "big-endian files are the ones that are swapped");

bool is_integer(PlyType type) { return type != PlyType::float32 && type != PlyType::float64; }

/// Values of an ASCII body, one after the other; line ends are blanks like any other.
class AsciiValues {
 public:
  AsciiValues(const std::string& bytes, const PlyHeader& header, const MeshFile& file)
      : file_(file),
        cursor_(bytes.data() + header.data_offset),
        end_(bytes.data() + bytes.size()),
        line_(header.data_line) {}

  double next(PlyType) {
    for (; cursor_ != end_ && (*cursor_ == ' ' || *cursor_ == '\t' || *cursor_ == '\r' || *cursor_ == '\n');
         ++cursor_)
      line_ += *cursor_ == '\n' ? 1 : 0;
    if (cursor_ == end_) fail("the file ends too early");
    double value = 0;
    const auto [rest, code] = std::from_chars(cursor_ + (*cursor_ == '+' ? 1 : 0), end_, value);
    const bool ends = rest == end_ || *rest == ' ' || *rest == '\t' || *rest == '\r' || *rest == '\n';
    if (code != std::errc() || !ends || !std::isfinite(value)) fail("expected a finite number");
    cursor_ = rest;
    return value;
  }

  [[noreturn]] void fail(const std::string& message) const { file_.damaged_at_line(line_, message); }

 private:
  const MeshFile& file_;
  const char* cursor_;
  const char* end_;
  size_t line_;
};

/// Values of a binary body.
class BinaryValues {
 public:
  BinaryValues(const std::string& bytes, const PlyHeader& header, const MeshFile& file)
      : file_(file),
        bytes_(bytes),
        offset_(header.data_offset),
        swap_(header.encoding == PlyEncoding::big_endian) {}

  double next(PlyType type) {
    switch (type) {
      case PlyType::int8:
        return load<int8_t>();
      case PlyType::uint8:
        return load<uint8_t>();
      case PlyType::int16:
        return load<int16_t>();
      case PlyType::uint16:
        return load<uint16_t>();
      case PlyType::int32:
        return load<int32_t>();
      case PlyType::uint32:
        return load<uint32_t>();
      case PlyType::float32:
        return static_cast<double>(load<float>());
      default:
        return load<double>();
    }
  }

  [[noreturn]] void fail(const std::string& message) const { file_.damaged_at_byte(offset_, message); }

 private:
  template <class T>
  T load() {
    char raw[sizeof(T)];
    if (bytes_.size() - offset_ < sizeof(T)) fail("the file ends too early");
    std::memcpy(raw, bytes_.data() + offset_, sizeof(T));
    if (swap_) std::reverse(raw, raw + sizeof(T));
    offset_ += sizeof(T);
    return std::bit_cast<T>(raw);
  }

  const MeshFile& file_;
  const std::string& bytes_;
  size_t offset_;
  bool swap_;
};

template <class Values>
uint64_t next_count(Values& values, const PlyProperty& property) {
  const double count = values.next(property.count_type);
  if (!(count >= 0 && count <= std::numeric_limits<uint32_t>::max()) || count != std::floor(count))
    values.fail("a list's count is no integer from 0 to 4294967295");
  return static_cast<uint64_t>(count);
}

template <class Values>
void skip(Values& values, const PlyProperty& property) {
  const uint64_t count = property.is_list ? next_count(values, property) : 1;
  for (uint64_t i = 0; i < count; ++i) values.next(property.type);
}

template <class Values>
void read_vertices(Values& values, const PlyElement& element, const MeshFile& file, Mesh& mesh) {
  const int x = element.find({"x"});
  const int y = element.find({"y"});
  const int z = element.find({"z"});
  const int nx = element.find({"nx"});
  const int ny = element.find({"ny"});
  const int nz = element.find({"nz"});
  const int u = element.find({"u", "s", "texture_u", "texture_s"});
  const int v = element.find({"v", "t", "texture_v", "texture_t"});
  if (x < 0 || y < 0 || z < 0) file.damaged("header", "the vertices have no x, y and z");
  for (const int used : {x, y, z, nx, ny, nz, u, v}) {
    if (used >= 0 && element.properties[static_cast<size_t>(used)].is_list)
      file.damaged("header", "vertex property \"" + element.properties[static_cast<size_t>(used)].name +
                                 "\" is a list");
  }
  const bool has_normals = nx >= 0 && ny >= 0 && nz >= 0;
  const bool has_uvs = u >= 0 && v >= 0;
  mesh.positions.reserve(element.count + 1);
  if (has_normals) mesh.normals.reserve(element.count);
  if (has_uvs) mesh.uvs.reserve(element.count);
  std::vector<float> row(element.properties.size());
  const auto at = [&row](int property) { return row[static_cast<size_t>(property)]; };
  for (uint64_t i = 0; i < element.count; ++i) {
    for (size_t p = 0; p < row.size(); ++p) {
      const PlyProperty& property = element.properties[p];
      if (property.is_list) {
        skip(values, property);
      } else {
        row[p] = static_cast<float>(values.next(property.type));
      }
    }
    mesh.positions.push_back({at(x), at(y), at(z)});
    if (has_normals) mesh.normals.push_back({at(nx), at(ny), at(nz)});
    if (has_uvs) mesh.uvs.push_back({at(u), at(v)});
  }
}

template <class Values>
uint32_t next_index(Values& values, const PlyProperty& property, uint64_t vertices) {
  const double index = values.next(property.type);
  if (!(index >= 0) || index >= static_cast<double>(vertices) || index != std::floor(index))
    values.fail("a face refers to a vertex that does not exist (there are " + std::to_string(vertices) + ")");
  return static_cast<uint32_t>(index);
}

template <class Values>
void read_faces(Values& values, const PlyElement& element, uint64_t vertices, const MeshFile& file,
                Mesh& mesh) {
  const int list = element.find({"vertex_indices", "vertex_index"});
  if (list < 0 || !element.properties[static_cast<size_t>(list)].is_list ||
      !is_integer(element.properties[static_cast<size_t>(list)].type))
    file.damaged("header", "the faces have no integer list \"vertex_indices\" or \"vertex_index\"");
  file.check_triangle_count(element.count);
  mesh.triangles.reserve(element.count);
  for (uint64_t i = 0; i < element.count; ++i) {
    for (size_t p = 0; p < element.properties.size(); ++p) {
      const PlyProperty& property = element.properties[p];
      if (static_cast<int>(p) != list) {
        skip(values, property);
        continue;
      }
      const uint64_t corners = next_count(values, property);
      if (corners < 3) values.fail("face " + std::to_string(i) + " has fewer than 3 vertices");
      const uint32_t first = next_index(values, property, vertices);
      uint32_t previous = next_index(values, property, vertices);
      for (uint64_t corner = 2; corner < corners; ++corner) {
        const uint32_t current = next_index(values, property, vertices);
        mesh.triangles.push_back({first, previous, current});
        previous = current;
      }
      file.check_triangle_count(mesh.triangles.size());
    }
  }
}

template <class Values>
Mesh read_body(Values values, const PlyHeader& header, const MeshFile& file) {
  uint64_t vertices = 0;
  for (const PlyElement& element : header.elements) {
    if (element.name == "vertex") vertices = element.count;
    if (element.name == "tristrips")
      file.fail(ErrorKind::unsupported, "UNSUPPORTED_MESH", "triangle strips are not supported; faces are");
  }
  if (vertices > 0xffffffffu)
    file.fail(ErrorKind::unsupported, "UNSUPPORTED_MESH", "more than 4294967295 vertices in one mesh");
  Mesh mesh;
  bool has_vertices = false;
  for (const PlyElement& element : header.elements) {
    if (element.name == "vertex") {
      if (has_vertices) file.damaged("header", "two elements \"vertex\"");
      has_vertices = true;
      read_vertices(values, element, file, mesh);
    } else if (element.name == "face") {
      read_faces(values, element, vertices, file, mesh);
    } else {
      for (uint64_t i = 0; i < element.count; ++i) {
        for (const PlyProperty& property : element.properties) skip(values, property);
      }
    }
  }
  return mesh;
}

}  // namespace

Mesh read_ply(const std::string& bytes, const MeshReadOptions& options, const SourceLocation& where) {
  const MeshFile file(options, where);
  const PlyHeader header = read_ply_header(bytes, file);
  if (header.encoding == PlyEncoding::ascii)
    return file.finish(read_body(AsciiValues(bytes, header, file), header, file));
  return file.finish(read_body(BinaryValues(bytes, header, file), header, file));
}

}  // namespace fogbank::scene
