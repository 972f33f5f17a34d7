#include "scene/scene_builder.h"

#include "scene/medium_reader.h"
#include "scene/text.h"

namespace fogbank::scene {

int32_t SceneBuilder::bsdf(const ObjectPointer& description) {
  const auto [entry, is_new] = bsdfs_.emplace(description, static_cast<int32_t>(scene_.bsdfs.size()));
  if (is_new) scene_.bsdfs.push_back(description);
  return entry->second;
}

int32_t SceneBuilder::default_bsdf(bool emits) {
  int32_t& index = emits ? emitter_default_bsdf_ : default_bsdf_;
  if (index == none) {
    auto diffuse = std::make_shared<ObjectDescription>();
    diffuse->tag = "bsdf";
    diffuse->type = "diffuse";
    diffuse->where.element = "<bsdf type=\"diffuse\"> (default)";
    if (emits) diffuse->properties.push_back({"reflectance", 0.0, diffuse->where});
    index = bsdf(diffuse);
  }
  return index;
}

bool SceneBuilder::passes_light(const ObjectPointer& bsdf) {
  if (const auto known = passes_light_.find(bsdf); known != passes_light_.end()) return known->second;
  bool passes = bsdf->type == "null" || bsdf->type == "mask" || bsdf->type == "thindielectric";
  for (const Property& property : bsdf->properties)
    if (const auto* nested = std::get_if<ObjectPointer>(&property.value); nested && (*nested)->tag == "bsdf")
      passes = passes_light(*nested) || passes;
  passes_light_[bsdf] = passes;
  return passes;
}

int32_t SceneBuilder::medium(const ObjectPointer& description) {
  if (const auto known = media_.find(description); known != media_.end()) return known->second;
  Medium medium = read_medium(*description, lenient_warnings());
  const auto index = static_cast<int32_t>(scene_.media.size());
  scene_.media.push_back(std::move(medium));
  media_[description] = index;
  return index;
}

std::vector<ObjectPointer> SceneBuilder::media() const {
  std::vector<ObjectPointer> result(scene_.media.size());
  for (const auto& [description, index] : media_) result[static_cast<size_t>(index)] = description;
  return result;
}

void SceneBuilder::add_emitter(const ObjectPointer& description) {
  if (shape_emitters_.count(description) == 0) scene_.emitters.push_back(description);
}

void SceneBuilder::unknown_plugin(const ObjectDescription& description,
                                  const std::vector<std::string>& supported, const std::string& substitute) {
  const std::string what = description.tag + " " + quote(description.type);
  if (!scene_.lenient)
    throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_PLUGIN", description.where,
                     what + " is not supported; supported: " + list_names(supported) +
                         did_you_mean(description.type, supported));
  scene_.warnings.push_back(description.where.to_string() + ": " + what + " " + substitute);
}

}  // namespace fogbank::scene
