// Wavefront OBJ (Alias|Wavefront, "Object Files", Advanced Visualizer manual, appendix B1): the polygonal
// subset.
//
// Not tinyobjloader: version 2.0.0rc10 of Debian 12 takes "v 1 abc 2" and "v nan 0 0" for zeros, fills up a
// vertex of two numbers, wraps an index of 99999999999 to some other vertex and says nothing in any of these
// cases, where a scene of ours must fail with the line.
#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <string_view>

#include "scene/mesh_reader_support.h"

namespace fogbank::scene {

namespace {

constexpr uint32_t absent = 0xffffffffu;

/// Indices of one corner of a face, from 0.
struct Corner {
  uint32_t position = absent;
  uint32_t uv = absent;
  uint32_t normal = absent;

  bool operator==(const Corner&) const = default;
};

/// Mixed by multiplication and folding, so that no pattern of indices in a file makes a table slow.
uint64_t hash(const Corner& corner) {
  uint64_t mixed = (static_cast<uint64_t>(corner.position) << 32 | corner.uv) * 0x9E3779B97F4A7C15u;
  mixed = (mixed ^ (mixed >> 29) ^ corner.normal) * 0xBF58476D1CE4E5B9u;
  return mixed ^ (mixed >> 32);
}

/// Largest index that a face uses, and where.
struct LargestIndex {
  uint64_t value = 0;
  size_t line = 0;
};

class ObjReader {
 public:
  ObjReader(const std::string& bytes, const MeshFile& file)
      : file_(file), cursor_(bytes.data()), end_(bytes.data() + bytes.size()) {}

  Mesh read() {
    while (cursor_ != end_) {
      read_statement();
      end_line();
    }
    check_range(largest_position_, positions_.size(), "vertex");
    check_range(largest_uv_, uvs_.size(), "texture coordinate");
    check_range(largest_normal_, normals_.size(), "normal");
    return assemble();
  }

 private:
  /// Blanks, and line ends that a backslash continues over.
  void skip_blanks() {
    for (; cursor_ != end_; ++cursor_) {
      if (*cursor_ == '\\') {
        const char* after = cursor_ + 1;
        if (after != end_ && *after == '\r') ++after;
        if (after == end_ || *after != '\n') return;
        cursor_ = after;
        ++line_;
      } else if (*cursor_ != ' ' && *cursor_ != '\t') {
        return;
      }
    }
  }

  bool at_line_end() const {
    return cursor_ == end_ || *cursor_ == '\n' || *cursor_ == '\r' || *cursor_ == '#';
  }

  void end_line() {
    while (cursor_ != end_ && *cursor_ != '\n') {
      if (*cursor_ == '\\') {
        skip_blanks();
        if (cursor_ == end_ || *cursor_ == '\n') continue;
      }
      ++cursor_;
    }
    if (cursor_ != end_) ++cursor_;
    ++line_;
  }

  std::string_view word() {
    skip_blanks();
    const char* start = cursor_;
    while (cursor_ != end_ && *cursor_ != ' ' && *cursor_ != '\t' && *cursor_ != '\n' && *cursor_ != '\r')
      ++cursor_;
    return {start, static_cast<size_t>(cursor_ - start)};
  }

  void read_statement() {
    skip_blanks();
    if (at_line_end()) return;
    const std::string_view keyword = word();
    if (keyword == "v") {
      positions_.push_back(read_vector("vertex"));
    } else if (keyword == "vn") {
      normals_.push_back(read_vector("normal"));
    } else if (keyword == "vt") {
      const float u = read_float("texture coordinate");
      skip_blanks();
      uvs_.push_back({u, at_line_end() ? 0.0f : read_float("texture coordinate")});
    } else if (keyword == "f" || keyword == "fo") {
      read_face();
    } else {
      refuse_unless_known(keyword);
    }
  }

  /// Statements without a meaning for a triangle mesh are passed over; free-form surfaces can't be.
  void refuse_unless_known(std::string_view keyword) const {
    static constexpr std::array ignored = {
        "g",         "o",          "s",     "mg",     "usemtl", "mtllib", "l",    "p",    "vp",   "bevel",
        "c_interp",  "d_interp",   "lod",   "usemap", "maplib", "cstype", "deg",  "bmat", "step", "parm",
        "trace_obj", "shadow_obj", "ctech", "stech",  "end",    "con",    "trim", "hole", "scrv", "sp"};
    static constexpr std::array unsupported = {"surf", "curv", "curv2", "call", "csh"};
    if (std::find(ignored.begin(), ignored.end(), keyword) != ignored.end()) return;
    if (std::find(unsupported.begin(), unsupported.end(), keyword) != unsupported.end())
      file_.fail(ErrorKind::unsupported, "UNSUPPORTED_MESH",
                 "line " + std::to_string(line_) + ": \"" + std::string(keyword) +
                     "\" is not supported; polygons (v, vt, vn, f) are");
    file_.damaged_at_line(line_,
                          "\"" + std::string(keyword.substr(0, 40)) + "\" is not a statement of an OBJ file");
  }

  float read_float(const char* what) {
    const std::string_view text = word();
    const char* start = text.data();
    const char* stop = start + text.size();
    if (start != stop && *start == '+') ++start;
    double value = 0;
    const auto [rest, code] = std::from_chars(start, stop, value);
    const auto single = static_cast<float>(value);
    if (code != std::errc() || rest != stop || !std::isfinite(single))
      file_.damaged_at_line(line_, std::string(what) + " needs finite numbers, not \"" +
                                       std::string(text.substr(0, 40)) + "\"");
    return single;
  }

  Vec3f read_vector(const char* what) {
    const float x = read_float(what);
    const float y = read_float(what);
    return {x, y, read_float(what)};
  }

  /// Index as written (from 1, or negative from the end) to one from 0.
  uint32_t read_index(const char*& start, const char* stop, size_t count, LargestIndex& largest,
                      const char* what) {
    int64_t value = 0;
    const auto [rest, code] = std::from_chars(start, stop, value);
    if (code != std::errc())
      file_.damaged_at_line(line_, "a face has something else than a " + std::string(what) + " index");
    start = rest;
    const int64_t index = value < 0 ? static_cast<int64_t>(count) + value : value - 1;
    if (value == 0 || index < 0 || index >= static_cast<int64_t>(absent))
      file_.damaged_at_line(line_,
                            std::string(what) + " index " + std::to_string(value) + " is out of range");
    if (static_cast<uint64_t>(index) >= largest.value) largest = {static_cast<uint64_t>(index) + 1, line_};
    return static_cast<uint32_t>(index);
  }

  /// "7", "7/2", "7//3" or "7/2/3"
  Corner read_corner(std::string_view text) {
    const char* start = text.data();
    const char* stop = start + text.size();
    Corner corner;
    corner.position = read_index(start, stop, positions_.size(), largest_position_, "vertex");
    if (start != stop && *start == '/') {
      ++start;
      if (start != stop && *start != '/')
        corner.uv = read_index(start, stop, uvs_.size(), largest_uv_, "texture coordinate");
      if (start != stop && *start == '/') {
        ++start;
        corner.normal = read_index(start, stop, normals_.size(), largest_normal_, "normal");
      }
    }
    if (start != stop)
      file_.damaged_at_line(line_, "\"" + std::string(text.substr(0, 40)) + "\" is not a corner of a face");
    return corner;
  }

  void read_face() {
    Corner first;
    Corner previous;
    size_t corners = 0;
    for (skip_blanks(); !at_line_end(); skip_blanks()) {
      const Corner corner = read_corner(word());
      if (corners == 0) {
        first = corner;
      } else if (corners > 1) {
        // A fan, as Mitsuba's reader makes it.
        corners_.insert(corners_.end(), {first, previous, corner});
        file_.check_triangle_count(corners_.size() / 3);
      }
      previous = corner;
      ++corners;
    }
    if (corners < 3) file_.damaged_at_line(line_, "a face needs 3 vertices or more");
  }

  void check_range(const LargestIndex& largest, size_t count, const char* what) const {
    if (largest.value > count)
      file_.damaged_at_line(largest.line, std::string(what) + " index " + std::to_string(largest.value) +
                                              " is out of range: there are " + std::to_string(count));
  }

  /// Corners with the same three indices become one vertex, numbered by first use.
  Mesh assemble() const {
    Mesh mesh;
    mesh.triangles.resize(corners_.size() / 3);
    std::vector<Corner> vertices;
    bool any_uv = false;
    bool any_normal = false;
    // Open addressing at a load of at most one half.
    std::vector<uint32_t> table(std::bit_ceil(2 * corners_.size() + 1), absent);
    for (size_t i = 0; i < corners_.size(); ++i) {
      const Corner& corner = corners_[i];
      size_t slot = hash(corner) & (table.size() - 1);
      while (table[slot] != absent && vertices[table[slot]] != corner) slot = (slot + 1) & (table.size() - 1);
      if (table[slot] == absent) {
        table[slot] = static_cast<uint32_t>(vertices.size());
        vertices.push_back(corner);
        any_uv = any_uv || corner.uv != absent;
        any_normal = any_normal || corner.normal != absent;
      }
      mesh.triangles[i / 3][static_cast<int>(i % 3)] = table[slot];
    }
    mesh.positions.reserve(vertices.size() + 1);
    for (const Corner& corner : vertices) {
      mesh.positions.push_back(positions_[corner.position]);
      if (any_uv) mesh.uvs.push_back(corner.uv == absent ? Vec2f(0) : uvs_[corner.uv]);
      if (any_normal) mesh.normals.push_back(corner.normal == absent ? Vec3f(0) : normals_[corner.normal]);
    }
    return mesh;
  }

  const MeshFile& file_;
  const char* cursor_;
  const char* end_;
  size_t line_ = 1;
  std::vector<Vec3f> positions_;
  std::vector<Vec3f> normals_;
  std::vector<Vec2f> uvs_;
  std::vector<Corner> corners_;
  LargestIndex largest_position_;
  LargestIndex largest_uv_;
  LargestIndex largest_normal_;
};

}  // namespace

Mesh read_obj(const std::string& bytes, const MeshReadOptions& options, const SourceLocation& where) {
  const MeshFile file(options, where);
  return file.finish(ObjReader(bytes, file).read());
}

}  // namespace fogbank::scene
