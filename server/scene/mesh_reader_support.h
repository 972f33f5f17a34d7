// What the mesh readers share: errors and the last steps to a valid mesh.
#pragma once

#include <cstddef>
#include <string>

#include "scene/mesh.h"
#include "scene/mesh_readers.h"

namespace fogbank::scene {

/// One mesh file being read: who asked for it, and how to say what is wrong with it.
class MeshFile {
 public:
  MeshFile(const MeshReadOptions& options, const SourceLocation& where) : options_(options), where_(where) {}

  const MeshReadOptions& options() const { return options_; }

  /// Throws SceneError "DAMAGED_MESH": "<shape>: <path>, <place>: <message>"; `place` is e.g. "line 12" or
  /// "byte 340".
  [[noreturn]] void damaged(const std::string& place, const std::string& message) const;
  [[noreturn]] void damaged_at_line(size_t line, const std::string& message) const;
  [[noreturn]] void damaged_at_byte(size_t offset, const std::string& message) const;
  [[noreturn]] void fail(ErrorKind kind, const std::string& reason, const std::string& message) const;
  /// Throws TOO_MANY_TRIANGLES when `count` is over LoadLimits::triangles.
  void check_triangle_count(uint64_t count) const;

  /// The mesh as the options ask for it, after these checks: indices in range, all values finite, at least
  /// one triangle with area.
  Mesh finish(Mesh mesh) const;

 private:
  const MeshReadOptions& options_;
  const SourceLocation& where_;
};

}  // namespace fogbank::scene
