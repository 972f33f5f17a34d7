#include "scene/texture_library.h"

#include <chrono>
#include <utility>

#include "core/sha256.h"
#include "scene/image_reader.h"
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

}  // namespace

TextureLibrary::TextureLibrary(std::shared_ptr<FileSource> files) : files_(std::move(files)) {}

TexturePointer TextureLibrary::texture(const ObjectPointer& description) {
  const auto known = textures_.find(description.get());
  if (known != textures_.end()) return known->second.second;
  PropertyReader reader(*description);
  const auto plugin = plugins().find(description->type);
  if (plugin == plugins().end()) {
    std::vector<std::string> names;
    for (const auto& [name, constructor] : plugins()) names.push_back(name);
    reader.fail("UNKNOWN_PLUGIN", "texture " + quote(description->type) + " is not supported; supported: " +
                                      list_names(names) + did_you_mean(description->type, names));
  }
  TexturePointer texture = plugin->second(reader, *this);
  reader.finish();
  textures_[description.get()] = {description, texture};
  return texture;
}

ImagePointer TextureLibrary::image(const std::string& path, bool raw, const SourceLocation& where) {
  const auto start = std::chrono::steady_clock::now();
  const auto hash = hashes_.find(path);
  if (hash != hashes_.end()) {
    const auto known = images_.find({hash->second, raw});
    if (known != images_.end()) return known->second;
  }
  std::string bytes;
  try {
    bytes = files_->read(path);
  } catch (const Error& error) {
    throw SceneError(error.kind(), error.reason(), where, error.what());
  }
  const std::pair content(sha256(bytes), raw);
  auto known = images_.find(content);
  if (known == images_.end())
    known =
        images_.emplace(content, std::make_shared<const Image>(read_image(bytes, path, raw, where))).first;
  hashes_[path] = content.first;
  seconds_ += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return known->second;
}

}  // namespace fogbank::scene
