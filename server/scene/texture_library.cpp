#include "scene/texture_library.h"

#include <chrono>
#include <utility>

#include "scene/scene_file_reader.h"
#include "scene/text.h"
#include "scene/textures/plugins.h"

namespace fogbank::scene {

namespace {

using Constructor = TexturePointer (*)(PropertyReader&, TextureLibrary&);

/// Every texture plugin, by name.
const std::map<std::string, Constructor>& plugins() {
  static const std::map<std::string, Constructor> all = {{"bitmap", make_bitmap_texture},
                                                         {"checkerboard", make_checkerboard_texture},
                                                         {"scale", make_scale_texture}};
  return all;
}

constexpr int largest_depth = 32;

/// Counts a level of nesting for its life time.
class DepthGuard {
 public:
  explicit DepthGuard(int& depth) : depth_(depth) { ++depth_; }
  ~DepthGuard() { --depth_; }
  DepthGuard(const DepthGuard&) = delete;
  DepthGuard& operator=(const DepthGuard&) = delete;

 private:
  int& depth_;
};

}  // namespace

TextureLibrary::TextureLibrary(std::shared_ptr<SceneFileReader> files, std::vector<std::string>* warnings)
    : files_(std::move(files)), warnings_(warnings) {}

TexturePointer TextureLibrary::texture(const ObjectPointer& description) {
  const auto known = textures_.find(description.get());
  if (known != textures_.end()) return known->second.second;
  PropertyReader reader(*description);
  const DepthGuard guard(depth_);
  if (depth_ > largest_depth)
    reader.fail("TEXTURES_NESTED_TOO_DEEPLY",
                "textures are nested more than " + std::to_string(largest_depth) + " levels deep");
  const auto plugin = plugins().find(description->type);
  TexturePointer texture;
  if (plugin != plugins().end()) {
    texture = plugin->second(reader, *this);
    reader.finish(warnings_);
  } else {
    std::vector<std::string> names;
    for (const auto& [name, constructor] : plugins()) names.push_back(name);
    const std::string message = "texture " + quote(description->type) +
                                " is not supported; supported: " + list_names(names) +
                                did_you_mean(description->type, names);
    if (warnings_ == nullptr) reader.fail("UNKNOWN_PLUGIN", message);
    warnings_->push_back(description->where.to_string() + ": " + message + "; a grey of 0.5 stands in");
    texture = constant_texture(Spectrum(0.5f));
  }
  textures_[description.get()] = {description, texture};
  return texture;
}

ImagePointer TextureLibrary::image(const std::string& path, bool raw, const SourceLocation& where) {
  const auto start = std::chrono::steady_clock::now();
  std::pair content(std::string(), raw);
  try {
    content.first = files_->hash(path);
  } catch (const SceneError&) {
    throw;
  } catch (const Error& error) {
    throw SceneError(error.kind(), error.reason(), where, error.what());
  }
  auto known = images_.find(content);
  if (known == images_.end())
    known = images_.emplace(content, std::make_shared<const Image>(files_->image(path, raw, where))).first;
  seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return known->second;
}

}  // namespace fogbank::scene
