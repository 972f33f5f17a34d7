#include "scene/scene.h"

namespace fogbank::scene {

size_t Scene::triangle_count() const {
  size_t count = 0;
  for (const Mesh& mesh : meshes) count += mesh.triangles.size();
  return count;
}

}  // namespace fogbank::scene
