// Mesh readers on small files written here: what they read, and what they refuse.
#include "scene/mesh_readers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <cstring>
#include <limits>

namespace fogbank::scene::test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const SourceLocation where{"scene.xml", 7, "<shape>"};

MeshReadOptions named(const std::string& path) {
  MeshReadOptions options;
  options.path = path;
  return options;
}

Mesh obj(const std::string& text, const MeshReadOptions& options = named("a.obj")) {
  return read_obj(text, options, where);
}
Mesh ply(const std::string& text, const MeshReadOptions& options = named("a.ply")) {
  return read_ply(text, options, where);
}

template <class Read>
void expect_refused(Read read, const std::string& reason, const std::string& message) {
  try {
    read();
    ADD_FAILURE() << "accepted; expected: " << message;
  } catch (const SceneError& error) {
    EXPECT_EQ(error.reason(), reason);
    EXPECT_THAT(error.what(), HasSubstr(message));
    EXPECT_EQ(error.where().line, where.line);
  }
}
void expect_damaged_obj(const std::string& text, const std::string& message) {
  expect_refused([&] { obj(text); }, "DAMAGED_MESH", "a.obj: " + message);
}
void expect_damaged_ply(const std::string& text, const std::string& message) {
  expect_refused([&] { ply(text); }, "DAMAGED_MESH", "a.ply: " + message);
}

const std::string three_vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

TEST(ObjReaderTest, PolygonsBecomeFans) {
  const Mesh mesh = obj("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv -1 .5 0\nf 1 2 3 4 5\n");
  EXPECT_THAT(mesh.triangles, ElementsAre(Vec3u(0, 1, 2), Vec3u(0, 2, 3), Vec3u(0, 3, 4)));
  EXPECT_EQ(mesh.positions.size(), 5u);
  EXPECT_TRUE(mesh.normals.empty());
  EXPECT_TRUE(mesh.uvs.empty());
  EXPECT_GT(mesh.positions.capacity(), mesh.positions.size()) << "the intersector would have to copy it";
}

TEST(ObjReaderTest, NegativeIndicesCountFromTheEnd) {
  const Mesh mesh = obj("v 9 9 9\n" + three_vertices + "f -3 -2 -1\n");
  EXPECT_THAT(mesh.positions, ElementsAre(Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)));
}

TEST(ObjReaderTest, SeparateIndicesAreUnified) {
  const std::string text = three_vertices +
                           "v 1 1 .5\nvt 0 0\nvt 1 0\nvt 0 1 .7\nvn 0 0 1\n"
                           "f 1/1/1 2/2/1 3/3/1\nf 3/1/1 2/2/1 4/3/1\n";
  const Mesh mesh = obj(text);
  EXPECT_THAT(mesh.triangles, ElementsAre(Vec3u(0, 1, 2), Vec3u(3, 1, 4)));
  EXPECT_THAT(mesh.uvs, ElementsAre(Vec2f(0, 0), Vec2f(1, 0), Vec2f(0, 1), Vec2f(0, 0), Vec2f(0, 1)));
  EXPECT_EQ(mesh.normals.size(), 5u);

  MeshReadOptions options = named("a.obj");
  options.flip_tex_coords = true;
  options.face_normals = true;
  const Mesh flipped = obj(text, options);
  EXPECT_EQ(flipped.uvs[2], Vec2f(0, 0));
  EXPECT_TRUE(flipped.normals.empty());
  EXPECT_TRUE(flipped.faceted);
}

TEST(ObjReaderTest, WhatIsMissingAtSomeCornersIsZero) {
  const Mesh mesh = obj(three_vertices + "v 1 1 0\nvn 0 0 1\nvt .5 .5\nf 1/1/1 2/1/1 3/1/1\nf 3 2 4\n");
  EXPECT_EQ(mesh.positions.size(), 6u);
  EXPECT_EQ(mesh.normals[0], Vec3f(0, 0, 1));
  EXPECT_EQ(mesh.normals[5], Vec3f(0, 0, 0));
  EXPECT_EQ(mesh.uvs[5], Vec2f(0, 0));
}

TEST(ObjReaderTest, SyntaxOfOldExporters) {
  const Mesh mesh = obj(
      "# comment\r\nmtllib a.mtl\r\no thing\r\ng a b\r\ns 1\r\n\r\nv  +0 0. 0e0 1.0\r\nv\t1 0 0 .5 .5 .5\r\n"
      "v 0 \\\r\n 1 0\r\nusemtl m # blue\r\nf 1 2 \\\r\n3 # last\r\nl 1 2");
  EXPECT_THAT(mesh.positions, ElementsAre(Vec3f(0, 0, 0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)));
  EXPECT_THAT(mesh.triangles, ElementsAre(Vec3u(0, 1, 2)));
}

TEST(ObjReaderTest, TrianglesWithoutAreaAreDroppedAndCounted) {
  const Mesh mesh = obj(three_vertices + "v 2 0 0\nf 1 2 3\nf 1 2 4\nf 1 1 2\n");
  EXPECT_EQ(mesh.triangles.size(), 1u);
  EXPECT_EQ(mesh.dropped_triangles, 2u);
}

TEST(ObjReaderTest, BadFilesAreRefusedWithTheLine) {
  expect_damaged_obj("v 1 abc 2\n", "line 1: vertex needs finite numbers, not \"abc\"");
  expect_damaged_obj("\nv nan 0 0\n", "line 2: vertex needs finite numbers, not \"nan\"");
  expect_damaged_obj("v 0 inf 0\n", "line 1: vertex needs finite numbers, not \"inf\"");
  expect_damaged_obj("v 0 0 1e999\n", "line 1: vertex needs finite numbers, not \"1e999\"");
  expect_damaged_obj("v 0 0 1e39\n", "line 1: vertex needs finite numbers, not \"1e39\"");
  expect_damaged_obj("v 0 0\n", "line 1: vertex needs finite numbers, not \"\"");
  expect_damaged_obj("vn 0 0 x\n", "line 1: normal needs finite numbers, not \"x\"");
  expect_damaged_obj("vt\n", "line 1: texture coordinate needs finite numbers");
  expect_damaged_obj(three_vertices + "f 1 2 9\n", "line 4: vertex index 9 is out of range: there are 3");
  expect_damaged_obj(three_vertices + "f 1 2 0\n", "line 4: vertex index 0 is out of range");
  expect_damaged_obj(three_vertices + "f 1 2 -4\n", "line 4: vertex index -4 is out of range");
  expect_damaged_obj(three_vertices + "f 1 2 99999999999\n",
                     "line 4: vertex index 99999999999 is out of range");
  expect_damaged_obj(three_vertices + "f 1 2 99999999999999999999\n", "line 4: a face has something else");
  expect_damaged_obj(three_vertices + "f 1/1 2 3\n",
                     "line 4: texture coordinate index 1 is out of range: there are 0");
  expect_damaged_obj(three_vertices + "f 1//2 2 3\nvn 0 0 1\n",
                     "line 4: normal index 2 is out of range: there are 1");
  expect_damaged_obj(three_vertices + "f 1 2\n", "line 4: a face needs 3 vertices");
  expect_damaged_obj(three_vertices + "f 1 2 x\n", "line 4: a face has something else than a vertex index");
  expect_damaged_obj(three_vertices + "f 1 2 3/1/1/1\n", "line 4:");
  expect_damaged_obj("PK\003\004", "line 1: \"PK\003\004\" is not a statement of an OBJ file");
  expect_refused([] { obj(three_vertices); }, "EMPTY_MESH", "a.obj: has no triangles");
  expect_refused([] { obj(""); }, "EMPTY_MESH", "a.obj: has no triangles");
  expect_refused([] { obj(three_vertices + "f 1 1 2\n"); }, "EMPTY_MESH",
                 "none of its 1 triangles has an area");
  expect_refused([] { obj("surf 0 1 0 1 1 2\n"); }, "UNSUPPORTED_MESH", "line 1: \"surf\" is not supported");
}

std::string ply_header(const std::string& format, int vertices, const std::string& more_properties,
                       int faces) {
  return "ply\nformat " + format + " 1.0\ncomment made here\nelement vertex " + std::to_string(vertices) +
         "\nproperty float x\nproperty float y\nproperty float z\n" + more_properties + "element face " +
         std::to_string(faces) + "\nproperty list uchar int vertex_indices\nend_header\n";
}

TEST(PlyReaderTest, Ascii) {
  const Mesh mesh =
      ply(ply_header("ascii", 4, "property float nx\nproperty float ny\nproperty float nz\n", 2) +
          "0 0 0 0 0 1\n1 0 0 0 0 1\n1 1 0 0 0 1\r\n0 1 0 0 1 0\n4 0 1 2 3\n3 0 2 3");
  EXPECT_THAT(mesh.triangles, ElementsAre(Vec3u(0, 1, 2), Vec3u(0, 2, 3), Vec3u(0, 2, 3)));
  EXPECT_EQ(mesh.normals[3], Vec3f(0, 1, 0));
  EXPECT_TRUE(mesh.uvs.empty());
}

TEST(PlyReaderTest, TextureCoordinatesUnderAllNames) {
  for (const auto& [u, v] :
       {std::pair{"u", "v"}, {"s", "t"}, {"texture_u", "texture_v"}, {"texture_s", "texture_t"}}) {
    const std::string properties = std::string("property float ") + u + "\nproperty float " + v + "\n";
    const std::string text =
        ply_header("ascii", 3, properties, 1) + "0 0 0 .25 .5\n1 0 0 0 0\n0 1 0 1 1\n3 0 1 2\n";
    EXPECT_EQ(ply(text).uvs.at(0), Vec2f(0.25f, 0.5f)) << u;
    MeshReadOptions options = named("a.ply");
    options.flip_tex_coords = true;
    EXPECT_EQ(ply(text, options).uvs.at(2), Vec2f(1, 0)) << u;
  }
}

template <class T>
void append(std::string& bytes, T value, bool swapped) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (swapped) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// A quad with doubles, an unused list, an unused element and 16-bit indices, so that every step over bytes
/// counts.
std::string binary_ply(bool big_endian) {
  std::string bytes =
      std::string("ply\nformat ") + (big_endian ? "binary_big_endian" : "binary_little_endian") +
      " 1.0\nobj_info none\nelement camera 1\nproperty short id\nelement vertex 4\n"
      "property list uchar ushort tags\nproperty double x\nproperty double y\nproperty uchar red\n"
      "property double z\nelement face 1\nproperty uint8 flags\n"
      "property list uint32 int16 vertex_index\nproperty float weight\nend_header\n";
  append<int16_t>(bytes, 5, big_endian);
  for (int i = 0; i < 4; ++i) {
    append<uint8_t>(bytes, static_cast<uint8_t>(i), big_endian);
    for (int tag = 0; tag < i; ++tag) append<uint16_t>(bytes, 77, big_endian);
    append<double>(bytes, i == 1 || i == 2 ? 1.0 : 0.0, big_endian);
    append<double>(bytes, i >= 2 ? 1.0 : 0.0, big_endian);
    append<uint8_t>(bytes, 255, big_endian);
    append<double>(bytes, 0.5, big_endian);
  }
  append<uint8_t>(bytes, 1, big_endian);
  append<uint32_t>(bytes, 4, big_endian);
  for (int i = 0; i < 4; ++i) append<int16_t>(bytes, static_cast<int16_t>(i), big_endian);
  append<float>(bytes, 2.0f, big_endian);
  return bytes;
}

TEST(PlyReaderTest, BinaryOfBothByteOrders) {
  for (const bool big_endian : {false, true}) {
    const Mesh mesh = ply(binary_ply(big_endian));
    EXPECT_THAT(mesh.positions,
                ElementsAre(Vec3f(0, 0, 0.5f), Vec3f(1, 0, 0.5f), Vec3f(1, 1, 0.5f), Vec3f(0, 1, 0.5f)));
    EXPECT_THAT(mesh.triangles, ElementsAre(Vec3u(0, 1, 2), Vec3u(0, 2, 3)));
  }
}

TEST(PlyReaderTest, EveryTruncationIsRefused) {
  const std::string whole = binary_ply(false);
  // The last property of the last face is read too, so any missing byte must be noticed.
  for (size_t length = 0; length < whole.size(); ++length)
    EXPECT_THROW(ply(whole.substr(0, length)), SceneError) << length;
}

TEST(PlyReaderTest, BadFilesAreRefusedWithThePlace) {
  const std::string body = "0 0 0\n1 0 0\n0 1 0\n";
  const std::string good = ply_header("ascii", 3, "", 1) + body;  // header: 10 lines
  expect_damaged_ply("", "line 1: the header has no end");
  expect_damaged_ply("obj\n", "line 1: a PLY file begins with \"ply\"");
  expect_damaged_ply("ply\nformat ascii 2.0\nend_header\n", "line 2: the format must be version 1.0");
  expect_damaged_ply("ply\nformat binary 1.0\nend_header\n", "line 2: unknown format");
  expect_damaged_ply("ply\nend_header\n", "line 2: the header states no format");
  expect_damaged_ply("ply\nproperty float x\n", "line 2: a property before any element");
  expect_damaged_ply("ply\nelement vertex -3\n", "line 2: \"-3\" is not a count");
  expect_damaged_ply("ply\nelement vertex 3\nproperty half x\n", "line 3: \"half\" is not a type");
  expect_damaged_ply("ply\nelement face 3\nproperty list float int a\n",
                     "line 3: a list's count must be an integer");
  expect_damaged_ply("ply\nvertices 3\n", "line 2: \"vertices\" is not a statement");
  expect_damaged_ply(good + "3 0 1 3\n",
                     "line 14: a face refers to a vertex that does not exist (there are 3)");
  expect_damaged_ply(good + "3 0 1 -1\n", "line 14: a face refers to a vertex that does not exist");
  expect_damaged_ply(good + "3 0 1 1.5\n", "line 14: a face refers to a vertex that does not exist");
  expect_damaged_ply(good + "2 0 1\n", "line 14: face 0 has fewer than 3 vertices");
  expect_damaged_ply(good + "3 0 1\n", "line 15: the file ends too early");
  expect_damaged_ply(good + "-3 0 1\n", "line 14: a list's count is no integer from 0 to 4294967295");
  expect_damaged_ply(good + "1e300 0 1\n", "line 14: a list's count is no integer from 0 to 4294967295");
  expect_damaged_ply(ply_header("ascii", 3, "", 1) + "0 0 nan\n1 0 0\n0 1 0\n3 0 1 2\n",
                     "line 11: expected a finite number");
  expect_damaged_ply(ply_header("ascii", 3, "", 1) + "0 0 0\n1 zero 0\n0 1 0\n3 0 1 2\n",
                     "line 12: expected a finite number");
  expect_damaged_ply(
      "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n",
      "header: the vertices have no x, y and z");
  expect_refused(
      [] { ply("ply\nformat ascii 1.0\nelement tristrips 0\nproperty list int int a\nend_header\n"); },
      "UNSUPPORTED_MESH", "triangle strips are not supported");
  expect_refused([] { ply(ply_header("ascii", 0, "", 0)); }, "EMPTY_MESH", "has no triangles");

  std::string binary = ply_header("binary_little_endian", 3, "", 1);
  for (int i = 0; i < 9; ++i)
    append<float>(binary, i == 4 ? std::numeric_limits<float>::quiet_NaN() : 1.0f, false);
  binary += '\3';
  for (int i = 0; i < 3; ++i) append<int32_t>(binary, i, false);
  expect_damaged_ply(binary, "vertex 1: has a value that is not a finite number");
}

TEST(PlyReaderTest, CountsThatTheFileCannotHoldAreRefusedBeforeAllocation) {
  for (const std::string format : {"ascii", "binary_little_endian"}) {
    std::string text = "ply\nformat " + format +
                       " 1.0\nelement vertex 18446744073709551615\nproperty float x\nproperty float y\n"
                       "property float z\nend_header\n";
    expect_damaged_ply(
        text, "header: claims 18446744073709551615 elements \"vertex\", more than the rest of the file");
    text = ply_header(format, 0, "", 2000000000) + "3 0 1 2\n";
    expect_damaged_ply(text, "header: claims 2000000000 elements \"face\"");
  }
  expect_damaged_ply("ply\nformat ascii 1.0\nelement vertex 99\nend_header\n",
                     "header: element \"vertex\" has no properties");
}

/// One mesh of a .serialized file, header included.
std::string serialized_mesh(uint16_t version, uint32_t flags, uint64_t vertices, uint64_t triangles,
                            const std::string& arrays) {
  std::string content;
  append(content, flags, false);
  if (version == 4) content += std::string("name\0", 5);
  append(content, vertices, false);
  append(content, triangles, false);
  content += arrays;
  std::string compressed(compressBound(content.size()), '\0');
  uLongf size = compressed.size();
  compress(reinterpret_cast<Bytef*>(compressed.data()), &size, reinterpret_cast<const Bytef*>(content.data()),
           content.size());
  std::string bytes;
  append<uint16_t>(bytes, 0x041C, false);
  append(bytes, version, false);
  return bytes + compressed.substr(0, size);
}

template <class Offset>
std::string serialized_file(const std::vector<std::string>& meshes) {
  std::string bytes;
  std::string table;
  for (const std::string& mesh : meshes) {
    append<Offset>(table, static_cast<Offset>(bytes.size()), false);
    bytes += mesh;
  }
  bytes += table;
  append<uint32_t>(bytes, static_cast<uint32_t>(meshes.size()), false);
  return bytes;
}

template <class Real>
std::string triangle_arrays(Real z, bool with_normals, bool with_uvs, uint32_t last_index = 2) {
  std::string bytes;
  const Real positions[] = {0, 0, z, 1, 0, z, 0, 1, z};
  for (const Real value : positions) append<Real>(bytes, value, false);
  for (int i = 0; with_normals && i < 3; ++i)
    for (const Real value : {Real(0), Real(0), Real(1)}) append<Real>(bytes, value, false);
  for (int i = 0; with_uvs && i < 6; ++i) append<Real>(bytes, static_cast<Real>(i), false);
  for (const uint32_t index : {0u, 1u, last_index}) append<uint32_t>(bytes, index, false);
  return bytes;
}

TEST(SerializedReaderTest, BothVersionsAndPrecisions) {
  const auto read = [](const std::string& bytes, int64_t index) {
    return read_serialized(bytes, index, named("a.serialized"), where);
  };
  const std::string single = triangle_arrays<float>(3, true, false);
  const std::string with_uvs = triangle_arrays<double>(4, false, true);
  const std::string v3 = serialized_file<uint32_t>(
      {serialized_mesh(3, 0x1001, 3, 1, single), serialized_mesh(3, 0x2002, 3, 1, with_uvs)});
  const std::string v4 = serialized_file<uint64_t>(
      {serialized_mesh(4, 0x1001, 3, 1, single), serialized_mesh(4, 0x2002, 3, 1, with_uvs)});
  for (const std::string& bytes : {v3, v4}) {
    const Mesh first = read(bytes, 0);
    EXPECT_EQ(first.positions[1], Vec3f(1, 0, 3));
    EXPECT_EQ(first.normals.size(), 3u);
    EXPECT_TRUE(first.uvs.empty());
    const Mesh second = read(bytes, 1);
    EXPECT_EQ(second.positions[2], Vec3f(0, 1, 4));
    EXPECT_TRUE(second.normals.empty());
    EXPECT_EQ(second.uvs[2], Vec2f(4, 5));
    EXPECT_THAT(second.triangles, ElementsAre(Vec3u(0, 1, 2)));
    expect_refused([&] { read(bytes, 2); }, "SHAPE_INDEX_OUT_OF_RANGE",
                   "a.serialized: has no mesh 2; it holds 2, counted from 0");
    expect_refused([&] { read(bytes, -1); }, "SHAPE_INDEX_OUT_OF_RANGE", "has no mesh -1");
    for (size_t length = 0; length < bytes.size(); ++length)
      EXPECT_THROW(read(bytes.substr(0, length), 0), SceneError) << length;
  }
}

TEST(SerializedReaderTest, BadFilesAreRefused) {
  const auto refused = [](const std::string& bytes, const std::string& reason, const std::string& message) {
    expect_refused([&] { read_serialized(bytes, 0, named("a.serialized"), where); }, reason, message);
  };
  const std::string arrays = triangle_arrays<float>(0, false, false);
  refused("SER_V1Q.........", "DAMAGED_MESH", "a.serialized: byte 0: not a Mitsuba .serialized mesh");
  refused("", "DAMAGED_MESH", "too short");
  refused(serialized_file<uint32_t>({serialized_mesh(2, 0x1000, 3, 1, arrays)}), "UNSUPPORTED_MESH",
          "version 2 of the .serialized format; 3 and 4 are supported");
  refused(serialized_file<uint32_t>({serialized_mesh(3, 0, 3, 1, arrays)}), "DAMAGED_MESH",
          "does not say whether it is in single or double precision");
  refused(serialized_file<uint32_t>({serialized_mesh(3, 0x1000, 4, 1, arrays)}), "DAMAGED_MESH",
          "the mesh ends too early");
  refused(serialized_file<uint32_t>({serialized_mesh(3, 0x1000, 100000000, 1, arrays)}), "DAMAGED_MESH",
          "claims 100000000 vertices and 1 triangles, more than its");
  refused(serialized_file<uint32_t>({serialized_mesh(3, 0x1000, ~uint64_t{0}, 1, arrays)}), "DAMAGED_MESH",
          "claims");
  refused(serialized_file<uint32_t>({serialized_mesh(3, 0x1000, 3, ~uint64_t{0}, arrays)}),
          "TOO_MANY_TRIANGLES", "more than 200000000 triangles");
  refused(serialized_file<uint32_t>(
              {serialized_mesh(3, 0x1000, 3, 1, triangle_arrays<float>(0, false, false, 3))}),
          "DAMAGED_MESH", "triangle 0: refers to vertex 3 of 3");
  refused(serialized_file<uint32_t>(
              {serialized_mesh(3, 0x1000, 3, 1, triangle_arrays<float>(infinity, false, false))}),
          "DAMAGED_MESH", "vertex 0: has a value that is not a finite number");
  std::string damaged = serialized_file<uint32_t>({serialized_mesh(3, 0x1000, 3, 1, arrays)});
  damaged[12] = static_cast<char>(damaged[12] ^ 0x55);
  refused(damaged, "DAMAGED_MESH", "a.serialized: ");
}

}  // namespace
}  // namespace fogbank::scene::test
