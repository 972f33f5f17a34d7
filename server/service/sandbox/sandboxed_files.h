// The files of a scene, taken apart by a reading process.
#pragma once

#include <memory>

#include "scene/file_source.h"
#include "scene/scene_file_reader.h"
#include "service/sandbox/reader_host.h"

namespace fogbank::service {

/// SceneFileReader whose every byte is parsed elsewhere. This side opens files (so that the rules of `files`
/// about paths hold), hashes them, and checks all that comes back. When the reading process dies, or says
/// what none of ours says, the call in progress throws SceneError naming the file: SCENE_READER_CRASHED
/// (invalid_argument), FILE_TAKES_TOO_LONG, FILE_TAKES_TOO_MUCH_MEMORY (resource_exhausted).
class SandboxedFiles final : public scene::SceneFileReader {
 public:
  SandboxedFiles(ReaderHost& host, std::shared_ptr<const scene::StoredFiles> files);
  ~SandboxedFiles() override;

  scene::ParsedScene parse(const std::string& main_path, const scene::LoadOptions& options) override;
  std::vector<std::string> references(const std::string& main_path,
                                      const scene::LoadOptions& options) override;
  scene::Mesh mesh(const scene::MeshFileRequest& request, const SourceLocation& where) override;
  scene::Image image(const std::string& path, bool raw, const SourceLocation& where) override;
  std::string hash(const std::string& path) override;

  /// Ends the reading process; nothing more can be read.
  void close();

 private:
  class Session;

  std::shared_ptr<const scene::StoredFiles> files_;
  std::unique_ptr<Session> session_;
};

}  // namespace fogbank::service
