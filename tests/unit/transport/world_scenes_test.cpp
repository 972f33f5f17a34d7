// Every scene file at hand, down to its BSDFs, lights and textures.
#include <gtest/gtest.h>

#include <filesystem>

#include "scene/loader.h"
#include "transport/world.h"

namespace fogbank::transport {
namespace {

struct SharedScene {
  const char* root;
  const char* file;
  const char* error;  ///< "" if it loads
};

const SharedScene shared_scenes[] = {
    {"data/analytic", "furnace_medium_isotropic.xml", ""},
    {"data/analytic", "absorbing_slab.xml", ""},
    {"data/analytic", "furnace_surface_box.xml", ""},
    {"data/classroom", "fog.xml", ""},
    {"data/classroom", "scene.xml",
     "scene.xml:901: <emitter type=\"sunsky\">: sunsky is not an emitter Fogbank knows; supported: area, "
     "constant, "
     "directional, envmap, point, spot"},
    {"data/classroom", "scene_v3.xml",
     "scene_v3.xml:881: <emitter type=\"sunsky\">: sunsky is not an emitter Fogbank knows; supported: area, "
     "constant, "
     "directional, envmap, point, spot"},
    {"data/staircase2", "scene.xml", ""},
    {"data/staircase2", "scene_v3.xml", ""},
    {"data/staircase2", "fog.xml", ""},
    {"data/statues", "room_fog.xml", ""},
    {"data/statues", "room_clear.xml", ""},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_area_light_volpath.xml", ""},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_null_envmap_volpath.xml", ""},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_homo_obj_inside_medium_volpath.xml", ""},
    {"data/mitsuba-tests", "tests/scenes/participating_media/test_surf_area_light_volpath.xml", ""},
};

std::string error_of(const std::string& root, const std::string& file, bool lenient) {
  try {
    scene::LoadOptions options;
    options.lenient = lenient;
    const World world(scene::load_scene(file, scene::folder_source(root), options));
    return "";
  } catch (const Error& error) {
    return error.what();
  }
}

/// The scenes that the scene library refuses by itself are in loader_scenes_test.cpp.
TEST(WorldOfSharedScenes, LoadsOrSaysWhyNot) {
  scene::prepare_render_thread();
  const char* shared = std::getenv("FOGBANK_SHARED");
  for (const SharedScene& expected : shared_scenes) {
    const std::string root = (shared != nullptr ? std::string(shared) : "../shared") + "/" + expected.root;
    if (!std::filesystem::exists(root)) GTEST_SKIP() << "shared data is absent: " << root;
    SCOPED_TRACE(root + "/" + expected.file);
    EXPECT_EQ(error_of(root, expected.file, false), expected.error);
    if (*expected.error != '\0') {
      EXPECT_EQ(error_of(root, expected.file, true), "");
    }
  }
}

TEST(WorldOfOwnScenes, Loads) {
  scene::prepare_render_thread();
  for (const std::string folder : {"scenes", "tests/oracle/scenes"}) {
    if (!std::filesystem::exists(folder)) continue;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
      if (entry.path().extension() == ".xml") {
        EXPECT_EQ(error_of(entry.path().parent_path().string(), entry.path().filename().string(), false), "")
            << entry.path();
      }
  }
}

}  // namespace
}  // namespace fogbank::transport
