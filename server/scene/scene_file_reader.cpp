#include "scene/scene_file_reader.h"

#include <map>
#include <utility>

#include "core/sha256.h"
#include "scene/image_reader.h"
#include "scene/loader.h"
#include "scene/xml/parser.h"

namespace fogbank::scene {
namespace {

class FilesInProcess final : public SceneFileReader {
 public:
  explicit FilesInProcess(std::shared_ptr<FileSource> files) : files_(std::move(files)) {}

  ParsedScene parse(const std::string& main_path, const LoadOptions& options) override {
    return parse_scene(main_path, *files_, options);
  }
  std::vector<std::string> references(const std::string& main_path, const LoadOptions& options) override {
    return list_references(main_path, files_, options);
  }
  Mesh mesh(const MeshFileRequest& request, const SourceLocation& where) override {
    return read_mesh(read(request.options.path, where), request, where);
  }
  Image image(const std::string& path, bool raw, const SourceLocation& where) override {
    return read_image(read(path, where), path, raw, where);
  }
  std::string hash(const std::string& path) override {
    const auto known = hashes_.find(path);
    return known != hashes_.end() ? known->second : hashes_[path] = sha256(files_->read(path));
  }

 private:
  std::string read(const std::string& path, const SourceLocation& where) {
    std::string bytes;
    try {
      bytes = files_->read(path);
    } catch (const Error& error) {
      throw SceneError(error.kind(), error.reason(), where, error.what());
    }
    hashes_.try_emplace(path, sha256(bytes));
    return bytes;
  }

  std::shared_ptr<FileSource> files_;
  std::map<std::string, std::string> hashes_;
};

}  // namespace

std::shared_ptr<SceneFileReader> read_in_process(std::shared_ptr<FileSource> files) {
  return std::make_shared<FilesInProcess>(std::move(files));
}

}  // namespace fogbank::scene
