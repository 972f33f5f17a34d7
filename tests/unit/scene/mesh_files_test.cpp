// Real mesh files: as many vertices and triangles as Mitsuba finds in them.
#include <gtest/gtest.h>

#include "scene/mesh_readers.h"
#include "scene/shared_data.h"

namespace fogbank::scene::test {
namespace {

struct Expected {
  const char* path;  ///< below data/
  size_t vertices;
  size_t triangles;
  size_t without_area;  ///< of these
  bool has_uvs;
};

// Counts from Mitsuba 3.9.1 (`vertex_count`, `face_count` of the loaded shape); triangles without area
// counted with NumPy from its buffers.
constexpr Expected files[] = {
    {"classroom/models/Mesh000.obj", 92, 50, 0, true},
    {"classroom/models/Mesh001.obj", 352, 350, 0, true},
    {"classroom/models/Mesh002.obj", 16, 8, 0, true},
    {"classroom/models/Mesh003.obj", 192, 112, 0, true},
    {"classroom/models/Mesh004.obj", 92, 50, 0, true},
    {"classroom/models/Mesh005.obj", 232, 392, 0, true},
    {"classroom/models/Mesh006.obj", 38, 50, 0, true},
    {"classroom/models/Mesh007.obj", 38, 50, 0, true},
    {"classroom/models/Mesh008.obj", 160, 188, 0, true},
    {"classroom/models/Mesh009.obj", 160, 188, 0, true},
    {"classroom/models/Mesh010.obj", 160, 188, 0, true},
    {"classroom/models/Mesh011.obj", 160, 188, 0, true},
    {"classroom/models/Mesh012.obj", 160, 188, 0, true},
    {"classroom/models/Mesh013.obj", 232, 392, 0, true},
    {"classroom/models/Mesh014.obj", 14177, 7966, 0, true},
    {"classroom/models/Mesh015.obj", 104, 56, 0, true},
    {"classroom/models/Mesh016.obj", 8, 4, 0, true},
    {"classroom/models/Mesh017.obj", 64, 32, 0, true},
    {"classroom/models/Mesh018.obj", 112, 80, 0, true},
    {"classroom/models/Mesh019.obj", 192, 128, 0, true},
    {"classroom/models/Mesh020.obj", 560, 304, 0, true},
    {"classroom/models/Mesh021.obj", 12, 6, 0, true},
    {"classroom/models/Mesh022.obj", 1448, 1152, 0, true},
    {"classroom/models/Mesh023.obj", 24, 12, 0, true},
    {"classroom/models/Mesh024.obj", 4080, 2600, 0, true},
    {"classroom/models/Mesh025.obj", 48, 24, 0, true},
    {"classroom/models/Mesh026.obj", 7680, 8640, 0, true},
    {"classroom/models/Mesh027.obj", 232, 120, 0, true},
    {"classroom/models/Mesh028.obj", 1500, 1152, 0, true},
    {"classroom/models/Mesh029.obj", 24, 12, 0, true},
    {"classroom/models/Mesh030.obj", 651, 646, 0, true},
    {"classroom/models/Mesh031.obj", 432, 272, 0, true},
    {"classroom/models/Mesh032.obj", 26, 32, 0, true},
    {"classroom/models/Mesh033.obj", 4, 2, 0, true},
    {"classroom/models/Mesh034.obj", 92, 50, 0, true},
    {"classroom/models/Mesh035.obj", 4, 2, 0, true},
    {"classroom/models/Mesh036.obj", 6775, 3712, 0, true},
    {"classroom/models/Mesh037.obj", 360, 320, 0, true},
    {"classroom/models/Mesh038.obj", 768, 384, 0, true},
    {"classroom/models/Mesh039.obj", 38, 50, 0, true},
    {"classroom/models/Mesh040.obj", 792, 432, 0, true},
    {"classroom/models/Mesh041.obj", 240, 200, 0, true},
    {"classroom/models/Mesh042.obj", 2310, 1514, 2, true},
    {"classroom/models/Mesh043.obj", 48, 24, 0, true},
    {"classroom/models/Mesh044.obj", 26, 32, 0, true},
    {"classroom/models/Mesh045.obj", 26, 32, 0, true},
    {"classroom/models/Mesh046.obj", 4, 2, 0, true},
    {"classroom/models/Mesh047.obj", 352, 350, 0, true},
    {"classroom/models/Mesh048.obj", 1152, 576, 0, true},
    {"classroom/models/Mesh049.obj", 92, 50, 0, true},
    {"classroom/models/Mesh050.obj", 192, 124, 0, true},
    {"classroom/models/Mesh051.obj", 192, 124, 0, true},
    {"classroom/models/Mesh052.obj", 14976, 29856, 0, true},
    {"classroom/models/Mesh053.obj", 368, 192, 0, true},
    {"classroom/models/Mesh054.obj", 4, 2, 0, true},
    {"classroom/models/Mesh055.obj", 24, 12, 0, true},
    {"classroom/models/Mesh056.obj", 4, 2, 0, true},
    {"classroom/models/Mesh057.obj", 384, 248, 0, true},
    {"classroom/models/Mesh058.obj", 96, 56, 0, true},
    {"classroom/models/Mesh059.obj", 160, 188, 0, true},
    {"classroom/models/Mesh060.obj", 360, 320, 0, true},
    {"classroom/models/Mesh061.obj", 192, 124, 0, true},
    {"classroom/models/Mesh062.obj", 586, 336, 0, true},
    {"classroom/models/Mesh063.obj", 5520, 5280, 0, true},
    {"classroom/models/Mesh064.obj", 15080, 27360, 0, true},
    {"classroom/models/Mesh065.obj", 160, 188, 0, true},
    {"classroom/models/Mesh066.obj", 60, 34, 0, true},
    {"classroom/models/Mesh067.obj", 720, 680, 0, true},
    {"classroom/models/Mesh068.obj", 3632, 2928, 0, true},
    {"classroom/models/Mesh069.obj", 1480, 1600, 0, true},
    {"classroom/models/Mesh070.obj", 160, 188, 0, true},
    {"classroom/models/Mesh071.obj", 38, 50, 0, true},
    {"classroom/models/Mesh072.obj", 4, 2, 0, true},
    {"classroom/models/Mesh073.obj", 80, 40, 0, true},
    {"classroom/models/Mesh074.obj", 160, 188, 0, true},
    {"classroom/models/Mesh075.obj", 26, 32, 0, true},
    {"classroom/models/Mesh076.obj", 132, 124, 0, true},
    {"classroom/models/Mesh077.obj", 4, 2, 0, true},
    {"classroom/models/Mesh078.obj", 160, 188, 0, true},
    {"hetvol/bounds.obj", 30, 12, 0, false},
    {"hetvol/plane.obj", 4, 2, 0, true},
    {"meshes/spot.obj", 3225, 5856, 0, true},
    {"meshes/suzanne.obj", 507, 968, 0, false},
    {"meshes/teapot.ply", 1177, 2256, 0, false},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/angled_cube.obj", 24, 12, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/background.obj", 8, 4, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/sphere_base.obj", 4864, 5632, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/sphere_tiny.obj", 1649, 3072, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/torus1.obj", 1239, 2320, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/torus2.obj", 1239, 2320, 0, true},
    {"mitsuba-tests/tests/scenes/participating_media/meshes/unit_cube_centered.obj", 24, 12, 0, true},
    {"staircase2/models/Mesh000.obj", 4204, 3127, 2327, true},
    {"staircase2/models/Mesh001.obj", 2016, 924, 0, true},
    {"staircase2/models/Mesh002.obj", 60, 32, 0, true},
    {"staircase2/models/Mesh003.obj", 2664, 5184, 0, true},
    {"staircase2/models/Mesh004.obj", 2664, 5184, 0, true},
    {"staircase2/models/Mesh005.obj", 20, 12, 0, true},
    {"staircase2/models/Mesh006.obj", 2664, 5184, 0, true},
    {"staircase2/models/Mesh007.obj", 60, 32, 0, true},
    {"staircase2/models/Mesh008.obj", 2664, 5184, 0, true},
    {"staircase2/models/Mesh009.obj", 218, 146, 105, true},
    {"staircase2/models/Mesh010.obj", 60, 32, 0, true},
    {"staircase2/models/Mesh011.obj", 30, 32, 0, true},
    {"staircase2/models/Mesh012.obj", 882, 444, 0, true},
    {"staircase2/models/Mesh013.obj", 2664, 5184, 0, true},
    {"staircase2/models/Mesh014.obj", 72, 36, 0, true},
    {"staircase2/models/Mesh015.obj", 60, 32, 0, true},
    {"staircase2/models/Mesh016.obj", 204, 120, 0, true},
    {"staircase2/models/Mesh017.obj", 40, 20, 0, true},
    {"staircase2/models/Mesh018.obj", 4, 2, 0, true},
    {"statues/meshes/athena.ply", 20285, 21000, 0, true},
    {"statues/meshes/dechalon.ply", 7466, 13572, 0, true},
    {"statues/meshes/hermes.ply", 11114, 19670, 0, true},
    {"statues/meshes/penelope.ply", 19931, 21000, 0, true},
    {"statues/meshes/plato.ply", 9019, 17064, 0, true},
};

// The same of the three meshes in one .serialized file.
constexpr Expected serialized[] = {
    {"meshes/serialized/matpreview.serialized", 289, 512, 0, true},
    {"meshes/serialized/matpreview.serialized", 2078, 3936, 0, true},
    {"meshes/serialized/matpreview.serialized", 29439, 57152, 0, true},
};

const SourceLocation where{"scene.xml", 1, "<shape>"};

void check(const Expected& expected, const Mesh& mesh) {
  EXPECT_EQ(mesh.positions.size(), expected.vertices) << expected.path;
  EXPECT_EQ(mesh.triangles.size() + mesh.dropped_triangles, expected.triangles) << expected.path;
  EXPECT_EQ(mesh.dropped_triangles, expected.without_area) << expected.path;
  EXPECT_EQ(mesh.uvs.size(), expected.has_uvs ? expected.vertices : 0) << expected.path;
}

TEST(MeshFilesTest, CountsAreThoseOfMitsuba) {
  size_t missing = 0;
  for (const Expected& expected : files) {
    std::string bytes;
    if (!fogbank::test::read_shared(std::string("data/") + expected.path, bytes)) {
      ++missing;
      continue;
    }
    const MeshReadOptions options;
    const bool is_ply = std::string_view(expected.path).ends_with(".ply");
    check(expected, is_ply ? read_ply(bytes, options, where) : read_obj(bytes, options, where));
  }
  if (missing > 0) GTEST_SKIP() << missing << " of " << std::size(files) << " shared mesh files are not here";
}

TEST(MeshFilesTest, SerializedCountsAreThoseOfMitsuba) {
  std::string bytes;
  if (!fogbank::test::read_shared("data/meshes/serialized/matpreview.serialized", bytes))
    GTEST_SKIP() << "shared file data/meshes/serialized/matpreview.serialized is not here";
  for (int64_t i = 0; i < 3; ++i) check(serialized[i], read_serialized(bytes, i, {}, where));
  EXPECT_THROW(read_serialized(bytes, 3, {}, where), SceneError);

  // A file of another program under the same ending.
  ASSERT_TRUE(fogbank::test::read_shared("data/meshes/serialized/reference.serialized", bytes));
  EXPECT_THROW(read_serialized(bytes, 0, {}, where), SceneError);
}

}  // namespace
}  // namespace fogbank::scene::test
