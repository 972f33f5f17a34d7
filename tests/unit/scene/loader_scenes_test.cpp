// Every scene file at hand: those of the repository, and the shared ones, which others wrote.
#include <gtest/gtest.h>

#include <filesystem>
#include <iostream>

#include "scene/loader.h"
#include "scene/scene_files.h"
#include "scene/shared_data.h"

namespace fogbank::scene::test {
namespace {

using fogbank::test::shared_path;

struct SharedScene {
  const char* root;
  const char* file;
  size_t shapes;
  size_t triangles;  ///< of the description that comes with the data, plus 2 a rectangle and 12 a cube
  size_t emitters;
  size_t media;
  size_t warnings;
};

/// The expected counts are those of the XML elements, counted with grep.
const SharedScene shared_scenes[] = {
    {"data/analytic", "furnace_medium_isotropic.xml", 1, 0, 1, 1, 0},
    {"data/analytic", "absorbing_slab.xml", 1, 12, 1, 1, 0},
    {"data/analytic", "furnace_surface_box.xml", 1, 12, 1, 0, 0},
    {"data/classroom", "scene.xml", 79, 103832, 1, 0, 10},
    {"data/classroom", "scene_v3.xml", 79, 103832, 1, 0, 1},
    {"data/classroom", "fog.xml", 80, 103832 + 12, 2, 1, 1},
    {"data/staircase2", "scene.xml", 32, 30927, 13, 0, 4},
    {"data/staircase2", "scene_v3.xml", 32, 30927, 13, 0, 2},
    {"data/staircase2", "fog.xml", 29, 30927 - 4 * 2 + 12, 11, 1, 2},
    {"data/statues", "room_fog.xml", 33, 0, 3, 1, 0},
    {"data/statues", "room_clear.xml", 32, 0, 3, 0, 0},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_area_light_volpath.xml", 4, 0, 1, 1,
     1},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_null_envmap_volpath.xml", 3, 0, 1, 1,
     1},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_obj_inside_medium_volpath.xml", 5, 0,
     1, 1, 1},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_surf_area_light_volpath.xml", 4, 0, 2, 0,
     1},
};

TEST(SharedScenes, Load) {
  prepare_render_thread();
  for (const SharedScene& expected : shared_scenes) {
    SCOPED_TRACE(std::string(expected.root) + "/" + expected.file);
    const std::string root = shared_path(expected.root);
    if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data is absent: " << root;
    const auto scene = load_scene(expected.file, folder_source(root), {});
    EXPECT_EQ(scene->shapes.size(), expected.shapes);
    if (expected.triangles > 0) {
      size_t without_area = 0;
      for (const Mesh& mesh : scene->meshes) without_area += mesh.dropped_triangles;
      EXPECT_EQ(scene->triangle_count() + without_area, expected.triangles);
    }
    EXPECT_EQ(scene->emitters.size(), expected.emitters);
    EXPECT_EQ(scene->media.size(), expected.media);
    EXPECT_EQ(scene->warnings.size(), expected.warnings);
    for (const std::string& warning : scene->warnings) std::cout << "  " << warning << "\n";
    EXPECT_EQ(scene->fingerprint.size(), 64u);
    EXPECT_GT(scene->bounds.radius, 0);
  }
}

TEST(SharedScenes, OldAndNewSyntaxDescribeTheSameScene) {
  const std::string root = shared_path("data/staircase2");
  if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data is absent: " << root;
  const auto old_scene = load_scene("scene.xml", folder_source(root), {});
  const auto new_scene = load_scene("scene_v3.xml", folder_source(root), {});
  EXPECT_EQ(old_scene->fingerprint, new_scene->fingerprint);
  EXPECT_EQ(old_scene->sensor.to_world, new_scene->sensor.to_world);
  EXPECT_EQ(old_scene->sensor.fov_x_degrees(old_scene->film),
            new_scene->sensor.fov_x_degrees(new_scene->film));
}

struct RefusedScene {
  const char* root;
  const char* file;
  const char* reason;
  const char* message;
};

TEST(SharedScenes, AreRefusedWithTheMessageTheyShould) {
  const RefusedScene scenes[] = {
      {"data/hetvol", "hetvol.xml", "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
       "hetvol.xml:9: <medium type=\"heterogeneous\" id=\"smoke\">: heterogeneous media ('heterogeneous') "
       "are not "
       "supported yet; supported: homogeneous, with constvolume at most"},
      {"data/hetvol", "hetvol_v3.xml", "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
       "hetvol_v3.xml:7: <medium type=\"heterogeneous\" id=\"smoke\">: heterogeneous media ('heterogeneous') "
       "are not "
       "supported yet; supported: homogeneous, with constvolume at most"},
      {"data/mitsuba-tests", "tests/scenes/participating_media/test_hetero_sigmat_volpath.xml",
       "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
       "tests/scenes/participating_media/test_hetero_sigmat_volpath.xml:12: <medium type=\"heterogeneous\" "
       "id=\"medium1\">: heterogeneous media ('heterogeneous') are not supported yet; supported: "
       "homogeneous, with "
       "constvolume at most"},
      {"data/mitsuba-tests", "tests/scenes/participating_media/test_hetero_sigmat_albedo_volpath.xml",
       "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
       "tests/scenes/participating_media/test_hetero_sigmat_albedo_volpath.xml:12: <medium "
       "type=\"heterogeneous\" "
       "id=\"medium1\">: heterogeneous media ('heterogeneous') are not supported yet; supported: "
       "homogeneous, with "
       "constvolume at most"},
      {"data/mitsuba-tests/tests", "scenes/participating_media/test_homo_null_envmap_volpath.xml",
       "PATH_OUTSIDE_ROOT",
       "scenes/participating_media/test_homo_null_envmap_volpath.xml:2: <path>: path '../../../common' leads "
       "out of "
       "the scene's root folder"},
      {"data/mitsuba-tests", "tests/scenes/participating_media/include/test-scene-base.xml", "FILE_NOT_FOUND",
       "tests/scenes/participating_media/include/test-scene-base.xml:3: <include>: file "
       "'tests/scenes/participating_media/include/include/preamble.xml' does not exist"},
  };
  for (const RefusedScene& expected : scenes) {
    const std::string root = shared_path(expected.root);
    if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data is absent: " << root;
    const Thrown thrown = thrown_by([&] { load_scene(expected.file, folder_source(root), {}); });
    EXPECT_EQ(thrown.reason, expected.reason);
    EXPECT_EQ(thrown.message, expected.message);
  }
}

/// All XML below a folder of this repository.
void load_all(const std::string& folder) {
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no folder " << folder;
  prepare_render_thread();
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() != ".xml") continue;
    SCOPED_TRACE(entry.path().string());
    const auto files = folder_source(entry.path().parent_path().string());
    const auto scene = load_scene(entry.path().filename().string(), files, {});
    // Ours are in the newest syntax; their generated meshes may have slivers.
    for (const std::string& warning : scene->warnings)
      EXPECT_NE(warning.find("have no area and are left out"), std::string::npos) << warning;
    for (const std::string& reference : list_references(entry.path().filename().string(), files, {}))
      EXPECT_TRUE(files->exists(reference)) << reference;
  }
}

TEST(OwnScenes, Load) { load_all("scenes"); }
TEST(OwnScenes, OracleScenesLoad) { load_all("tests/oracle/scenes"); }

}  // namespace
}  // namespace fogbank::scene::test
