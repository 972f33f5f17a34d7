// Estimators against finite differences in whole scenes, at points that the camera looks through.
#pragma once

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "core/random.h"
#include "derivatives/estimator.h"
#include "scene/loader.h"
#include "scene/shared_data.h"

namespace fogbank::derivatives::test {

/// The files of a folder, with the scene file changed in memory: the directional light is replaced by a disk
/// far away, the sun given a finite angular radius, and the constant environment is taken out if its light is
/// not wanted.
class FiniteSun : public scene::FileSource {
 public:
  /// Half the angle that the disk subtends (rad): twice the sun's. The disk is `distance` (scene units) from
  /// `center`, a point in the middle of the room.
  static constexpr double angular_radius = 0.0093;
  static constexpr double distance = 60;

  FiniteSun(const std::string& root, std::string scene_file, const Vec3d& center, bool with_sky)
      : files_(scene::folder_source(root)),
        scene_file_(std::move(scene_file)),
        center_(center),
        with_sky_(with_sky) {}

  bool exists(const std::string& path) const override { return files_->exists(path); }
  std::string read(const std::string& path) const override {
    const std::string bytes = files_->read(path);
    return path == scene_file_ ? with_disk(bytes) : bytes;
  }

 private:
  static Vec3d triple(const std::string& text) {
    std::string spaced = text;
    std::replace(spaced.begin(), spaced.end(), ',', ' ');
    std::istringstream stream(spaced);
    Vec3d value;
    stream >> value.x >> value.y >> value.z;
    return value;
  }

  /// Same irradiance across the direction at the centre: radiance times pi sin^2 of the radius.
  std::string with_disk(const std::string& xml) const {
    const std::regex sun(
        R"re(<emitter type="directional">\s*<vector name="direction" value="([^"]*)"\s*/>\s*<rgb name="irradiance" value="([^"]*)"\s*/>\s*</emitter>)re");
    std::smatch match;
    if (!std::regex_search(xml, match, sun))
      throw std::runtime_error("no directional light in " + scene_file_);
    const Vec3d position = center_ - glm::normalize(triple(match[1])) * distance;
    const Vec3d radiance = triple(match[2]) / (3.14159265358979 * std::pow(std::sin(angular_radius), 2));
    std::ostringstream disk;
    disk << "<shape type=\"disk\" id=\"sun\"><transform name=\"to_world\"><scale value=\""
         << distance * std::tan(angular_radius) << "\"/><lookat origin=\"" << position.x << ", " << position.y
         << ", " << position.z << "\" target=\"" << center_.x << ", " << center_.y << ", " << center_.z
         << "\" up=\"0.1, 1, 0.2\"/></transform><emitter type=\"area\"><rgb name=\"radiance\" value=\""
         << radiance.x << ", " << radiance.y << ", " << radiance.z << "\"/></emitter></shape>";
    std::string changed = match.prefix().str() + disk.str() + match.suffix().str();
    if (with_sky_) return changed;
    const std::regex sky(R"re(<emitter type="constant">\s*<rgb[^>]*/>\s*</emitter>)re");
    return std::regex_replace(changed, sky, "");
  }

  std::shared_ptr<scene::FileSource> files_;
  std::string scene_file_;
  Vec3d center_;
  bool with_sky_;
};

struct ComparedScene {
  const char* name;
  const char* folder;  ///< below the shared data
  const char* file;
  Vec3d center;
};

/// The two real scenes of the shared data that have fog in a room and a sun.
inline const std::vector<ComparedScene>& compared_scenes() {
  static const std::vector<ComparedScene> scenes{
      {"statues", "data/statues", "room_fog.xml", Vec3d(5, 2, 3)},
      {"classroom", "data/classroom", "fog.xml", Vec3d(0, 1.5, 0)},
  };
  return scenes;
}

/// Null where the shared data is absent.
inline std::shared_ptr<const transport::World> load_with_finite_sun(const ComparedScene& scene,
                                                                    bool with_sky) {
  scene::prepare_render_thread();
  const std::string root = fogbank::test::shared_path(scene.folder);
  if (!std::filesystem::exists(root)) return nullptr;
  return std::make_shared<const transport::World>(scene::load_scene(
      scene.file, std::make_shared<FiniteSun>(root, scene.file, scene.center, with_sky), {}));
}

/// Points in a medium, uniform on the part of random camera rays before the first surface.
inline std::vector<Vec3f> points_before_the_camera(const transport::World& world, int count, uint64_t seed) {
  const scene::Scene& scene = world.scene();
  std::vector<Vec3f> points;
  for (uint32_t i = 0; static_cast<int>(points.size()) < count && i < 100u * static_cast<uint32_t>(count);
       ++i) {
    RandomStream random(seed, i, 0, 0);
    const Vec2f pixel = random.next_vec2() * Vec2f(scene.film.width, scene.film.height);
    const Ray ray = scene.sensor.sample_ray(scene.film, pixel, random.next_vec2());
    scene::Hit hit;
    if (!scene.intersector->intersect(ray, hit)) continue;
    const Vec3f x = ray.at(hit.distance * (0.02f + 0.96f * random.next_float()));
    if (world.medium_at(x) != scene::none) points.push_back(x);
  }
  return points;
}

/// Relative errors of luminance derivatives at one point.
struct DerivativeErrors {
  double gradient = 0;
  double hessian = 0;
  double angle = 0;  ///< between the gradients, degrees
};

/// The size of a reference below which it counts as this size: dark points would else divide by nothing.
struct ReferenceFloor {
  double gradient = 0;
  double hessian = 0;
};

inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1, static_cast<size_t>(share * static_cast<double>(values.size())))];
}

/// 5 % of the median size over all points that are lit at all.
inline ReferenceFloor reference_floor(const std::vector<PointEstimate>& references) {
  std::vector<double> gradients;
  std::vector<double> hessians;
  for (const PointEstimate& reference : references) {
    const Jet3d jet = reference.mean.luminance();
    if (!(jet.value > 0)) continue;
    gradients.push_back(glm::length(jet.gradient));
    hessians.push_back(jet.hessian.norm());
  }
  return {0.05 * quantile(gradients, 0.5), 0.05 * quantile(hessians, 0.5)};
}

inline DerivativeErrors errors_of(const Jet3d& found, const Jet3d& reference, const ReferenceFloor& floor) {
  DerivativeErrors errors;
  const double length = glm::length(reference.gradient);
  errors.gradient = glm::length(found.gradient - reference.gradient) / std::max(length, floor.gradient);
  errors.hessian =
      (found.hessian - reference.hessian).norm() / std::max(reference.hessian.norm(), floor.hessian);
  const double product = length * glm::length(found.gradient);
  if (product > 0)
    errors.angle = glm::degrees(
        std::acos(std::clamp(glm::dot(found.gradient, reference.gradient) / product, -1.0, 1.0)));
  return errors;
}

}  // namespace fogbank::derivatives::test
