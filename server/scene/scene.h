// The loaded scene: immutable, shared by all jobs that render it.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/vector.h"
#include "scene/description.h"
#include "scene/field_identity.h"
#include "scene/intersector.h"
#include "scene/medium.h"
#include "scene/mesh.h"
#include "scene/sensor.h"
#include "scene/shape.h"
#include "scene/texture_library.h"

namespace fogbank::scene {

struct BoundingSphere {
  Vec3f center{0};
  float radius = 0;
};

/// What the file's `<integrator>` and `<sampler>` ask for; a job may override each.
struct RenderDefaults {
  /// Not the file's, whose "volpath" says no more than that it is to be rendered: the one that suits the
  /// scene, "radiance-cache" where records hold what fog scatters.
  std::string integrator = "volpath";
  int32_t max_depth = -1;  ///< path length in edges as in Mitsuba: 1 = emitted light only; -1 = unbounded
  /// Not the file's: on scenes/penumbra 2 has half to a third of the variance x time that 5 and 8 have.
  int32_t rr_depth = 2;
  bool hide_emitters = false;
  int32_t samples_per_pixel = 16;
};

/// Seconds of each stage of loading.
struct LoadTimes {
  double parse = 0;
  double meshes = 0;
  double textures = 0;
  double acceleration = 0;
};

struct Scene {
  std::vector<Mesh> meshes;
  std::vector<Shape> shapes;
  int32_t group_count = 0;
  std::vector<Instance> instances;
  std::vector<Medium> media;
  std::vector<ObjectPointer> bsdfs;     ///< descriptions; `transport` builds them
  std::vector<ObjectPointer> emitters;  ///< descriptions; area lights are referred to by `Shape::emitter`,
                                        ///< all others stand for themselves
  std::unique_ptr<TextureLibrary> textures;
  Sensor sensor;
  Film film;
  RenderDefaults defaults;
  BoundingSphere bounds;    ///< of all surfaces; radius > 0 unless the scene is empty
  std::string fingerprint;  ///< 64 hex digits: SHA-256 over everything the radiance field depends on, file
                            ///< contents included
  FieldIdentity field;      ///< what cached light is kept by: unlike the fingerprint apart from emission
  bool lenient = false;
  std::vector<std::string> warnings;
  LoadTimes load_times;
  std::unique_ptr<Intersector> intersector;

  size_t triangle_count() const;
  /// Everything shading needs to know about a hit.
  SurfaceInteraction interaction(const Ray& ray, const Hit& hit) const;
};

}  // namespace fogbank::scene
