// Scene files: the XML of a main file, with a mesh, a spectrum and a file to include beside it.
#include <cmath>

#include "fuzz.h"
#include "scene/intersector.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

using namespace fogbank;

namespace {

const char* const mesh =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";

std::shared_ptr<scene::FileSource> files_with(const std::string& xml) {
  return std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{
      {"scene.xml", xml},
      {"part.xml", "<scene version='3.0.0'><emitter type='constant'/></scene>"},
      {"mesh.ply", mesh},
      {"colour.spd", "400 1\n700 2\n"}});
}

void check(const scene::Scene& scene) {
  fuzz::require(is_finite(scene.bounds.center) && std::isfinite(scene.bounds.radius), "bounds are finite");
  for (const scene::Medium& medium : scene.media)
    fuzz::require(is_finite(medium.sigma_t) && is_finite(medium.albedo), "media are finite");
  const Ray ray = scene.sensor.sample_ray(scene.film, {0.5f, 0.5f}, {0.3f, 0.7f});
  fuzz::require(is_finite(ray.origin) && is_finite(ray.direction) && ray.max_distance > 0,
                "camera rays are finite");
}

}  // namespace

int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  scene::prepare_render_thread();
  return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const auto files = files_with(fuzz::bytes_of(data, size));
  const bool is_scene = fuzz::accepts([&] { check(*scene::load_scene("scene.xml", files, {})); });
  const bool has_references = fuzz::accepts([&] { scene::list_references("scene.xml", files, {}); });
  fuzz::require(has_references || !is_scene, "a scene has a list of references");
  const bool is_lenient_scene = fuzz::accepts(
      [&] { check(*scene::load_scene("scene.xml", files, {.parameters = {}, .lenient = true})); });
  fuzz::require(is_lenient_scene || !is_scene, "lenient loading takes what strict loading takes");
  return 0;
}
