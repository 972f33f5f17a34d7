#include "scene/loader.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "scene/bounds.h"
#include "scene/fingerprint.h"
#include "scene/scene_builder.h"
#include "scene/sensor_reader.h"
#include "scene/text.h"
#include "scene/xml/parser.h"

namespace fogbank::scene {
namespace {

class Stopwatch {
 public:
  double seconds() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

/// Of several objects of a kind that a scene needs once the first counts.
void note_extra(const ObjectPointer& object, Scene& scene) {
  scene.warnings.push_back(object->where.to_string() + ": passed over: the scene has a <" + object->tag +
                           "> already");
}

/// Shapes first: they decide which emitters stand for themselves.
void build(const std::vector<ObjectPointer>& objects, SceneBuilder& builder) {
  Scene& scene = builder.scene();
  for (const ObjectPointer& object : objects)
    if (object->tag == "shape") builder.add_shape(object);
  bool has_sensor = false;
  bool has_integrator = false;
  for (const ObjectPointer& object : objects) {
    if (object->tag == "emitter") {
      builder.add_emitter(object);
    } else if (object->tag == "medium") {
      builder.medium(object);
    } else if (object->tag == "sensor") {
      if (has_sensor)
        note_extra(object, scene);
      else
        read_sensor(*object, builder);
      has_sensor = true;
    } else if (object->tag == "integrator") {
      if (has_integrator)
        note_extra(object, scene);
      else
        read_integrator(*object, scene.defaults, scene.warnings);
      has_integrator = true;
    }
  }
  if (!has_sensor)
    scene.warnings.push_back("the scene has no <sensor>; a perspective camera at the origin is used");
}

bool has_records(const Medium& medium) {
  if (medium.phase == nullptr || medium.phase->type == "isotropic") return true;
  if (medium.phase->type != "hg") return false;
  // As `transport` reads it, which refuses what is out of range.
  constexpr double any = std::numeric_limits<double>::infinity();
  const double mean_cosine = PropertyReader(*medium.phase).number("g", 0.8, -any, any);
  return std::fabs(mean_cosine) <= static_cast<double>(most_recorded_mean_cosine);
}

/// Without fog that records hold paths do as well.
std::string default_integrator(const Scene& scene) {
  const bool fog = std::ranges::any_of(scene.media, [](const Medium& medium) {
    const Spectrum sigma_s = medium.sigma_s();
    return (sigma_s.x > 0 || sigma_s.y > 0 || sigma_s.z > 0) && has_records(medium);
  });
  return fog ? "radiance-cache" : "volpath";
}

}  // namespace

std::shared_ptr<Scene> load_scene(const std::string& main_path, std::shared_ptr<FileSource> files,
                                  const LoadOptions& options) {
  return load_scene(main_path, read_in_process(std::move(files)), options);
}

std::shared_ptr<Scene> load_scene(const std::string& main_path, std::shared_ptr<SceneFileReader> files,
                                  const LoadOptions& options) {
  auto scene = std::make_shared<Scene>();
  scene->lenient = options.lenient;
  const Stopwatch parse_watch;
  ParsedScene parsed = files->parse(main_path, options);
  scene->warnings = std::move(parsed.warnings);
  scene->load_times.parse = parse_watch.seconds();

  const Stopwatch mesh_watch;
  SceneBuilder builder(*scene, *files);
  build(parsed.objects, builder);
  scene->bounds = surface_bounds(*scene);
  scene->defaults.integrator = default_integrator(*scene);
  // Shapes are checked one by one; only an instance's transform can still lead beyond.
  if (!(scene->bounds.radius <= 4 * LoadLimits::coordinate))
    throw Error(ErrorKind::invalid_argument, "COORDINATE_TOO_LARGE",
                "the scene's instances extend beyond " + number_text(LoadLimits::coordinate));
  scene->fingerprint = radiance_fingerprint(parsed.objects, *files);
  scene->field = field_identity(parsed.objects, builder.media(), scene->emitters, *files);
  scene->load_times.meshes = mesh_watch.seconds();

  scene->textures = std::make_unique<TextureLibrary>(files, scene->lenient ? &scene->warnings : nullptr);
  const Stopwatch acceleration_watch;
  scene->intersector = std::make_unique<Intersector>(*scene);
  scene->load_times.acceleration = acceleration_watch.seconds();
  return scene;
}

}  // namespace fogbank::scene
