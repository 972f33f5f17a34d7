// Mitsuba scene files (XML, versions 0.5 to 3) to `Scene`.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "scene/file_source.h"
#include "scene/scene.h"
#include "scene/scene_file_reader.h"

namespace fogbank::scene {

struct LoadOptions {
  std::map<std::string, std::string> parameters;  ///< `$name` values, over the file's `<default>`s
  bool lenient = false;  ///< substitute what is unknown, with a warning each, instead of failing
};

/// Limits of one scene file, all checked before memory is spent.
struct LoadLimits {
  static constexpr int depth = 64;  ///< nested elements, includes counted in
  static constexpr int elements = 1'000'000;
  static constexpr int attributes = 4'000'000;
  static constexpr int includes = 64;
  static constexpr size_t xml_bytes = 64u << 20;
  static constexpr size_t attribute_bytes = 1u << 20;
  static constexpr size_t file_bytes = size_t{2} << 30;
  static constexpr size_t triangles = 200'000'000;
  static constexpr double coordinate = 1e15;  ///< in scene units, either sign: squares still fit a float
  static constexpr int image_side = 32768;
  static constexpr size_t image_bytes = size_t{1} << 30;  ///< decoded
};

/// Parses, builds and indexes the scene. Throws SceneError (file, line, element) for anything wrong in it,
/// Error for the rest.
std::shared_ptr<Scene> load_scene(const std::string& main_path, std::shared_ptr<SceneFileReader> files,
                                  const LoadOptions& options);
/// With the files read by this process.
std::shared_ptr<Scene> load_scene(const std::string& main_path, std::shared_ptr<FileSource> files,
                                  const LoadOptions& options);

/// Only the paths that `main_path` refers to (includes, meshes, textures), found or not, without reading
/// meshes or images: what a client has to upload. Includes that are missing stop the search behind them; ask
/// again when they are there.
std::vector<std::string> list_references(const std::string& main_path, std::shared_ptr<FileSource> files,
                                         const LoadOptions& options);

}  // namespace fogbank::scene
