// Worlds made of scene files: of a folder, or of text in memory.
#pragma once

#include <map>
#include <memory>
#include <string>

#include "scene/loader.h"
#include "scene/memory_files.h"
#include "transport/world.h"

namespace fogbank::transport::test {

inline std::shared_ptr<const World> load_world(const std::string& root, const std::string& file) {
  scene::prepare_render_thread();
  return std::make_shared<const World>(scene::load_scene(file, scene::folder_source(root), {}));
}

/// `body`: what stands between <scene> and </scene>.
inline std::shared_ptr<const World> parse_world(const std::string& body) {
  scene::prepare_render_thread();
  const std::string xml = "<scene version=\"3.0.0\">" + body + "</scene>";
  return std::make_shared<const World>(scene::load_scene(
      "scene.xml",
      std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{{"scene.xml", xml}}),
      {}));
}

}  // namespace fogbank::transport::test
