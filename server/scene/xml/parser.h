// Scene files to descriptions.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/file_source.h"
#include "scene/loader.h"

namespace fogbank::scene {

struct ParsedScene {
  std::vector<ObjectPointer> objects;  ///< directly in <scene>, in document order
  std::vector<std::string> warnings;
};

/// Throws SceneError: as SceneExpander::expand; UNKNOWN_ELEMENT, UNKNOWN_ATTRIBUTE, MISSING_ATTRIBUTE,
/// MISPLACED_ELEMENT, INVALID_VALUE, INVALID_TRANSFORM, DUPLICATE_ID, DUPLICATE_PARAMETER, UNKNOWN_ID,
/// REFERENCE_CYCLE, FILE_NOT_FOUND.
ParsedScene parse_scene(const std::string& main_path, FileSource& files, const LoadOptions& options);

}  // namespace fogbank::scene
