// What goes between the server and the process that reads scene files, and what the server refuses of it.
#include "service/sandbox/encoding.h"

#include <gtest/gtest.h>

#include "core/random.h"
#include "scene/memory_files.h"

namespace fogbank::service {
namespace {

scene::ParsedScene parsed_scene() {
  const std::map<std::string, std::string> contents = {{"scene.xml", R"(<scene version="3.0.0">
    <bsdf type="diffuse" id="grey"><rgb name="reflectance" value="0.25, 0.5, 0.75"/></bsdf>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.1"/></medium>
    <sensor type="perspective"><float name="fov" value="30"/><integer name="n" value="-7"/>
      <transform name="to_world"><rotate x="1" angle="30"/></transform><ref name="medium" id="fog"/></sensor>
    <shape type="sphere"><point name="center" x="1" y="2" z="3"/><boolean name="flip_normals" value="true"/>
      <ref id="grey"/><ref name="interior" id="fog"/></shape>
    <shape type="cube"><ref id="grey"/><string name="what" value="ü"/></shape></scene>)"}};
  scene::test::MemoryFiles files(contents);
  return scene::parse_scene("scene.xml", files, {});
}

void expect_same(const scene::ObjectDescription& a, const scene::ObjectDescription& b) {
  EXPECT_EQ(a.tag, b.tag);
  EXPECT_EQ(a.type, b.type);
  EXPECT_EQ(a.id, b.id);
  EXPECT_EQ(a.where.to_string(), b.where.to_string());
  ASSERT_EQ(a.properties.size(), b.properties.size());
  for (size_t i = 0; i < a.properties.size(); ++i) {
    EXPECT_EQ(a.properties[i].name, b.properties[i].name);
    EXPECT_EQ(a.properties[i].where.to_string(), b.properties[i].where.to_string());
    ASSERT_EQ(a.properties[i].value.index(), b.properties[i].value.index());
    if (const auto* nested = std::get_if<scene::ObjectPointer>(&a.properties[i].value))
      expect_same(**nested, *std::get<scene::ObjectPointer>(b.properties[i].value));
    else
      EXPECT_EQ(a.properties[i].value, b.properties[i].value);
  }
}

TEST(Encoding, ScenesComeBackWithWhatTheyShare) {
  scene::ParsedScene scene = parsed_scene();
  scene.warnings = {"a warning"};
  const scene::ParsedScene back = decode_scene(encode(scene));
  EXPECT_EQ(back.warnings, scene.warnings);
  ASSERT_EQ(back.objects.size(), scene.objects.size());
  for (size_t i = 0; i < scene.objects.size(); ++i) expect_same(*scene.objects[i], *back.objects[i]);
  EXPECT_EQ(std::get<scene::ObjectPointer>(back.objects[3]->properties[2].value), back.objects[0]);
  EXPECT_EQ(std::get<scene::ObjectPointer>(back.objects[4]->properties[0].value), back.objects[0]);
}

TEST(Encoding, RequestsComeBack) {
  const SourceLocation where{"scene.xml", 7, "<shape>"};
  ParseRequest parse{"a/scene.xml", {.parameters = {{"x", "1"}, {"y", ""}}, .lenient = true}};
  const ParseRequest parse_back = decode_parse_request(encode(parse));
  EXPECT_EQ(parse_back.main_path, parse.main_path);
  EXPECT_EQ(parse_back.options.parameters, parse.options.parameters);
  EXPECT_TRUE(parse_back.options.lenient);

  MeshRequest mesh;
  mesh.file = {
      .type = "serialized",
      .shape_index = 3,
      .options = {
          .path = "m", .face_normals = true, .flip_tex_coords = false, .max_smooth_angle_degrees = 30}};
  mesh.where = where;
  const MeshRequest mesh_back = decode_mesh_request(encode(mesh));
  EXPECT_EQ(mesh_back.file.type, "serialized");
  EXPECT_EQ(mesh_back.file.shape_index, 3);
  EXPECT_EQ(mesh_back.file.options.path, "m");
  EXPECT_TRUE(mesh_back.file.options.face_normals);
  EXPECT_FALSE(mesh_back.file.options.flip_tex_coords);
  EXPECT_EQ(mesh_back.file.options.max_smooth_angle_degrees, 30);
  EXPECT_EQ(mesh_back.where.to_string(), where.to_string());

  const ImageRequest image_back = decode_image_request(encode(ImageRequest{"i.png", true, where}));
  EXPECT_EQ(image_back.path, "i.png");
  EXPECT_TRUE(image_back.raw);
}

TEST(Encoding, ErrorsComeBackWithTheirPlace) {
  // With a byte of a file that is no UTF-8.
  const SceneError error(ErrorKind::unsupported, "REASON", {"scene.xml", 7, "<shape>"}, "a: message \xff");
  try {
    throw_decoded_error(encode(error));
  } catch (const SceneError& back) {
    EXPECT_STREQ(back.what(), error.what());
    EXPECT_EQ(back.reason(), "REASON");
    EXPECT_EQ(back.kind(), ErrorKind::unsupported);
    EXPECT_EQ(back.where().line, 7);
  }
  EXPECT_THROW(throw_decoded_error(encode(Error(ErrorKind::not_found, "R", "m"))), Error);
}

/// A process that a hostile file has taken over may say anything.
TEST(Encoding, DamageIsRefusedOrHarmless) {
  const std::string good = encode(parsed_scene());
  int refused = 0;
  for (uint32_t i = 0; i < 20000; ++i) {
    RandomStream random(3, i, 0, 0);
    std::string bytes = good;
    for (uint32_t edits = 1 + random.next_uint() % 3; edits > 0; --edits)
      bytes[random.next_uint() % bytes.size()] = static_cast<char>(random.next_uint());
    if (i % 8 == 0) bytes.resize(random.next_uint() % bytes.size());
    try {
      decode_scene(bytes);
    } catch (const BadMessage&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, 5000);
}

TEST(Encoding, NestingIsBounded) {
  scene::ObjectPointer object = std::make_shared<scene::ObjectDescription>();
  for (int i = 0; i <= 100; ++i) {
    auto around = std::make_shared<scene::ObjectDescription>();
    around->properties.push_back({"", object, {}});
    object = around;
    if (i == 50) {
      EXPECT_EQ(decode_scene(encode(scene::ParsedScene{{object}, {}})).objects.size(), 1u);
    }
  }
  EXPECT_THROW(decode_scene(encode(scene::ParsedScene{{object}, {}})), BadMessage);
}

TEST(Encoding, MeshesAndImagesAreHeldAgainstWhatTheyCanBe) {
  const MeshHeader good{
      .positions = 3, .normals = 0, .uvs = 3, .triangles = 1, .dropped_triangles = 0, .faceted = 0};
  EXPECT_NO_THROW(check(good));
  MeshHeader header = good;
  header.normals = 2;
  EXPECT_THROW(check(header), BadMessage);
  header = good;
  header.triangles = scene::LoadLimits::triangles + 1;
  EXPECT_THROW(check(header), BadMessage);
  header = good;
  header.positions = uint64_t{1} << 40;
  EXPECT_THROW(check(header), BadMessage);

  scene::Mesh mesh;
  mesh.positions = {Vec3f(0), Vec3f(1, 0, 0), Vec3f(0, 1, 0)};
  mesh.triangles = {Vec3u(0, 1, 2)};
  EXPECT_NO_THROW(check(mesh));
  mesh.triangles = {Vec3u(0, 1, 3)};
  EXPECT_THROW(check(mesh), BadMessage);
  mesh.triangles = {Vec3u(0, 1, 2)};
  mesh.positions[2].x = infinity;
  EXPECT_THROW(check(mesh), BadMessage);

  EXPECT_NO_THROW(check(ImageHeader{.width = 4, .height = 4, .channels = 3, .is_bytes = 1}));
  EXPECT_THROW(check(ImageHeader{.width = 4, .height = 4, .channels = 4, .is_bytes = 1}), BadMessage);
  EXPECT_THROW(check(ImageHeader{.width = 32768, .height = 32768, .channels = 3, .is_bytes = 0}), BadMessage);
  EXPECT_THROW(check(ImageHeader{.width = -1, .height = 4, .channels = 3, .is_bytes = 1}), BadMessage);
}

}  // namespace
}  // namespace fogbank::service
