// The files of one scene, taken apart: by this process, or by one that can do nothing else (service/sandbox).
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "core/error.h"
#include "scene/file_source.h"
#include "scene/mesh_readers.h"

namespace fogbank::scene {

struct Image;
struct LoadOptions;
struct ParsedScene;

/// A mesh that a shape asks for; its path is `options.path`.
struct MeshFileRequest {
  std::string type;  ///< plugin: "obj", "ply" or "serialized"
  int64_t shape_index = 0;
  MeshReadOptions options;
};

/// Not thread-safe. Everything throws SceneError or Error for what is wrong with a file.
class SceneFileReader {
 public:
  virtual ~SceneFileReader() = default;

  /// As parse_scene (xml/parser.h).
  virtual ParsedScene parse(const std::string& main_path, const LoadOptions& options) = 0;
  /// As list_references (loader.h).
  virtual std::vector<std::string> references(const std::string& main_path, const LoadOptions& options) = 0;
  /// As the reader of the type (mesh_readers.h).
  virtual Mesh mesh(const MeshFileRequest& request, const SourceLocation& where) = 0;
  /// As read_image (image_reader.h).
  virtual Image image(const std::string& path, bool raw, const SourceLocation& where) = 0;
  /// SHA-256 of a file's contents, computed once: 64 hexadecimal digits. What `mesh` and `image` return is of
  /// these very contents.
  virtual std::string hash(const std::string& path) = 0;
};

/// Read and taken apart by the caller's thread.
std::shared_ptr<SceneFileReader> read_in_process(std::shared_ptr<FileSource> files);

}  // namespace fogbank::scene
