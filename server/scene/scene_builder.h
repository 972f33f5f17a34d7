// Shares descriptions while a scene is filled: each BSDF and medium once, whatever refers to it.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "scene/scene.h"
#include "scene/scene_file_reader.h"

namespace fogbank::scene {

/// Adds objects to a scene. Indices returned stay valid.
class SceneBuilder {
 public:
  SceneBuilder(Scene& scene, SceneFileReader& files) : scene_(scene), files_(files) {}

  /// Index in `Scene::bsdfs`.
  int32_t bsdf(const ObjectPointer& description);
  /// The BSDF of a shape that names none: diffuse with the plugin's default reflectance, but black where the
  /// shape `emits` (as in every version of Mitsuba).
  int32_t default_bsdf(bool emits);
  /// Does light pass straight through it (`null`, `mask`, `thindielectric` or a BSDF that nests one)?
  bool passes_light(const ObjectPointer& bsdf);
  /// Index in `Scene::media`. Throws as `read_medium`.
  int32_t medium(const ObjectPointer& description);
  /// Descriptions of `Scene::media`.
  std::vector<ObjectPointer> media() const;

  /// Adds one `<shape>` with its mesh, BSDF, media and area light; `shapegroup` and `instance` too. Throws
  /// SceneError.
  void add_shape(const ObjectPointer& description);
  /// Adds an emitter that stands for itself, unless a shape refers to it.
  void add_emitter(const ObjectPointer& description);

  /// Refuses a plugin, naming the supported ones; when loading leniently it warns that `substitute` ("is
  /// replaced by
  /// ...", "is left out") and returns.
  void unknown_plugin(const ObjectDescription& description, const std::vector<std::string>& supported,
                      const std::string& substitute);

  Scene& scene() { return scene_; }
  /// Where unknown parameters go: null when loading strictly, so that they are errors.
  std::vector<std::string>* lenient_warnings() { return scene_.lenient ? &scene_.warnings : nullptr; }

 private:
  void add_surface(const ObjectPointer& description, int32_t group);
  void add_instance(const ObjectPointer& description);
  int32_t group(const ObjectPointer& description);
  int32_t add_mesh(PropertyReader& reader, const Mat4d& to_world);
  Mesh read_mesh_file(PropertyReader& reader);
  /// Area in world space.
  double light_area(const Shape& shape) const;

  Scene& scene_;
  SceneFileReader& files_;
  size_t triangle_count_ = 0;
  int32_t default_bsdf_ = none;
  int32_t emitter_default_bsdf_ = none;
  std::map<ObjectPointer, int32_t> bsdfs_;
  std::map<ObjectPointer, int32_t> media_;
  std::map<ObjectPointer, int32_t> groups_;
  std::map<ObjectPointer, bool> passes_light_;
  std::map<ObjectPointer, int32_t> shape_emitters_;  ///< area lights by description, with their first index
};

}  // namespace fogbank::scene
