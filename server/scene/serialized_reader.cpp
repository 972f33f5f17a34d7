// Mitsuba's .serialized meshes: a file of zlib streams, one a mesh, and a table of their offsets at its end.
// The layout is the one documented at Mitsuba's `serialized` plugin.
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "scene/loader.h"
#include "scene/mesh_reader_support.h"

namespace fogbank::scene {

namespace {

static_assert(std::endian::native == std::endian::little, "the format is little endian");

constexpr uint16_t format_identifier = 0x041C;
constexpr size_t header_bytes = 4;  ///< identifier and version, before every mesh
/// Deflate can't expand more than this (zlib's technical details: 1032:1 at most), so a count that needs more
/// is a lie.
constexpr uint64_t largest_expansion = 1032;

/// 0x10, "face normals", is left out: Mitsuba 3.9.1 ignores it too (found by experiment), and pictures shall
/// agree.
namespace flag {
constexpr uint32_t normals = 0x0001;
constexpr uint32_t texture_coordinates = 0x0002;
constexpr uint32_t colors = 0x0008;
constexpr uint32_t single_precision = 0x1000;
constexpr uint32_t double_precision = 0x2000;
}  // namespace flag

template <class T>
T load(const std::string& bytes, size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof(T));
  return value;
}

/// Decompresses one stream piece by piece; says where in the file it breaks.
class InflateStream {
 public:
  InflateStream(const std::string& bytes, size_t begin, size_t end, const MeshFile& file)
      : file_(file), begin_(begin), size_(end - begin) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + begin));
    if (inflateInit(&stream_) != Z_OK)
      file.fail(ErrorKind::resource_exhausted, "OUT_OF_MEMORY", "no memory to decompress");
  }
  ~InflateStream() { inflateEnd(&stream_); }
  InflateStream(const InflateStream&) = delete;
  InflateStream& operator=(const InflateStream&) = delete;

  void read(void* target, uint64_t bytes) {
    auto* out = static_cast<Bytef*>(target);
    while (bytes > 0) {
      constexpr uint64_t piece = 1u << 30;  // zlib counts in 32 bits
      const auto room = static_cast<uInt>(std::min(bytes, piece));
      const auto input = static_cast<uInt>(std::min<uint64_t>(size_ - consumed_, piece));
      stream_.next_out = out;
      stream_.avail_out = room;
      stream_.avail_in = input;
      const int code = inflate(&stream_, Z_NO_FLUSH);
      consumed_ += input - stream_.avail_in;
      const uInt got = room - stream_.avail_out;
      out += got;
      bytes -= got;
      if (code != Z_OK && code != Z_STREAM_END)
        file_.damaged_at_byte(begin_ + consumed_, "the compressed data is damaged or cut off");
      if (code == Z_STREAM_END && bytes > 0)
        file_.damaged_at_byte(begin_ + consumed_, "the mesh ends too early");
    }
  }
  template <class T>
  T value() {
    T v;
    read(&v, sizeof(T));
    return v;
  }

 private:
  const MeshFile& file_;
  z_stream stream_{};
  size_t begin_;
  uint64_t size_;
  uint64_t consumed_ = 0;
};

/// `count` tuples of N numbers, stored single or double, as single.
template <int N>
std::vector<glm::vec<N, float>> read_vectors(InflateStream& stream, uint64_t count, bool is_double) {
  std::vector<glm::vec<N, float>> vectors(count);
  if (!is_double) {
    stream.read(vectors.data(), count * sizeof(vectors[0]));
    return vectors;
  }
  constexpr uint64_t block = 4096;
  std::vector<glm::vec<N, double>> doubles(std::min(count, block));
  for (uint64_t done = 0; done < count; done += block) {
    const uint64_t n = std::min(block, count - done);
    stream.read(doubles.data(), n * sizeof(doubles[0]));
    std::copy_n(doubles.begin(), n, vectors.begin() + static_cast<ptrdiff_t>(done));
  }
  return vectors;
}

/// Byte range of mesh `shape_index`, without its header. Version 3 has 32-bit offsets, version 4 64-bit ones.
struct Extent {
  size_t begin = 0;
  size_t end = 0;
  uint16_t version = 0;
};

uint16_t read_header(const std::string& bytes, size_t offset, const MeshFile& file) {
  const auto identifier = load<uint16_t>(bytes, offset);
  const auto version = load<uint16_t>(bytes, offset + 2);
  if (identifier != format_identifier) file.damaged_at_byte(offset, "not a Mitsuba .serialized mesh");
  if (version != 3 && version != 4)
    file.fail(ErrorKind::unsupported, "UNSUPPORTED_MESH",
              "version " + std::to_string(version) + " of the .serialized format; 3 and 4 are supported");
  return version;
}

Extent find_mesh(const std::string& bytes, int64_t shape_index, const MeshFile& file) {
  if (bytes.size() < 2 * header_bytes) file.damaged_at_byte(bytes.size(), "too short for a .serialized file");
  const uint16_t version = read_header(bytes, 0, file);
  const auto count = load<uint32_t>(bytes, bytes.size() - 4);
  const uint64_t entry = version == 4 ? 8 : 4;
  const uint64_t table_bytes = entry * count + 4;
  if (count == 0 || table_bytes + header_bytes > bytes.size())
    file.damaged_at_byte(bytes.size() - 4, "the table of meshes does not fit into the file");
  if (shape_index < 0 || shape_index >= static_cast<int64_t>(count))
    file.fail(ErrorKind::invalid_argument, "SHAPE_INDEX_OUT_OF_RANGE",
              "has no mesh " + std::to_string(shape_index) + "; it holds " + std::to_string(count) +
                  ", counted from 0");
  const size_t table = bytes.size() - table_bytes;
  const auto offset = [&](uint64_t index) -> uint64_t {
    return version == 4 ? load<uint64_t>(bytes, table + 8 * index) : load<uint32_t>(bytes, table + 4 * index);
  };
  const auto index = static_cast<uint64_t>(shape_index);
  const uint64_t begin = offset(index);
  const uint64_t end = index + 1 < count ? offset(index + 1) : table;
  if (end > table || begin > end || end - begin < header_bytes)
    file.damaged_at_byte(table + entry * index,
                         "mesh " + std::to_string(shape_index) + " lies outside the file");
  return {begin + header_bytes, end, read_header(bytes, begin, file)};
}

void skip_name(InflateStream& stream, size_t begin, const MeshFile& file) {
  constexpr int longest_name = 4096;
  for (int i = 0; i < longest_name; ++i) {
    if (stream.value<char>() == '\0') return;
  }
  file.damaged_at_byte(begin, "the mesh's name does not end");
}

}  // namespace

Mesh read_serialized(const std::string& bytes, int64_t shape_index, const MeshReadOptions& options,
                     const SourceLocation& where) {
  const MeshFile file(options, where);
  const Extent extent = find_mesh(bytes, shape_index, file);
  InflateStream stream(bytes, extent.begin, extent.end, file);
  const auto flags = stream.value<uint32_t>();
  if (extent.version == 4) skip_name(stream, extent.begin, file);
  const bool is_double = (flags & flag::double_precision) != 0;
  if (is_double == ((flags & flag::single_precision) != 0))
    file.damaged_at_byte(extent.begin, "does not say whether it is in single or double precision");

  const auto vertices = stream.value<uint64_t>();
  const auto triangles = stream.value<uint64_t>();
  file.check_triangle_count(triangles);
  const uint64_t numbers =
      3 + ((flags & flag::normals) != 0 ? 3 : 0) + ((flags & flag::texture_coordinates) != 0 ? 2 : 0);
  const uint64_t most_bytes = largest_expansion * (extent.end - extent.begin);
  // A mesh has no use for more vertices than its triangles have corners, but files may hold them.
  if (vertices > most_bytes || triangles > most_bytes ||
      vertices * numbers * (is_double ? 8 : 4) + triangles * 12 > most_bytes)
    file.damaged_at_byte(extent.begin, "claims " + std::to_string(vertices) + " vertices and " +
                                           std::to_string(triangles) + " triangles, more than its " +
                                           std::to_string(extent.end - extent.begin) + " bytes can hold");
  if (vertices > 0xffffffffu)
    file.fail(ErrorKind::unsupported, "UNSUPPORTED_MESH", "more than 4294967295 vertices in one mesh");

  Mesh mesh;
  mesh.positions = read_vectors<3>(stream, vertices, is_double);
  if ((flags & flag::normals) != 0) mesh.normals = read_vectors<3>(stream, vertices, is_double);
  if ((flags & flag::texture_coordinates) != 0) mesh.uvs = read_vectors<2>(stream, vertices, is_double);
  if ((flags & flag::colors) != 0) read_vectors<3>(stream, vertices, is_double);
  mesh.triangles.resize(triangles);
  stream.read(mesh.triangles.data(), triangles * sizeof(Vec3u));
  return file.finish(std::move(mesh));
}

}  // namespace fogbank::scene
