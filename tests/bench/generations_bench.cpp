// What a record of reflected and multiply scattered light costs and how far off it is, by generation and
// number of directions, in a scene given on the command line; one JSON object a line. Times are CPU seconds
// of one thread for one record. generations.py prints.
//
//   generations_bench SCENE.xml POINTS SEEDS REFERENCE_PATHS DIRECTIONS...
//
// The points lie on camera rays, in media that scatter. The sources of a generation are records
// of the one before at places that the makers ask for, thinned as fills do.
#include <time.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <map>
#include <nlohmann/json.hpp>

#include "cache/cached_light.h"
#include "cache/record_maker.h"
#include "cache/thinning.h"
#include "core/sampling.h"
#include "scene/loader.h"

namespace fogbank::cache {
namespace {

/// Distance between sources, in radii of the scene.
constexpr double spacing_radii = 0.15;

double cpu_seconds() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

std::vector<Vec3f> points_in_view(const transport::World& world, int count) {
  const scene::Scene& scene = world.scene();
  RandomStream random(1, 0, 0, 0);
  std::vector<Vec3f> points;
  while (static_cast<int>(points.size()) < count) {
    const Vec2f film = random.next_vec2() * Vec2f(scene.film.width, scene.film.height);
    const Ray ray = scene.sensor.sample_ray(scene.film, film, random.next_vec2());
    const float share = random.next_float();
    scene::Hit hit;
    if (!scene.intersector->intersect_solid(ray, hit)) continue;
    const Vec3f x = ray.at(share * hit.distance);
    const int32_t medium = world.medium_at(x);
    if (medium != scene::none && !is_black(world.medium(medium).sigma_s)) points.push_back(x);
  }
  return points;
}

struct Reference {
  double mean = 0;
  double standard_error = 0;
};

/// Luminance of the light that doesn't come straight from emitters, path traced.
Reference path_traced(const transport::PathTracer& kernel, const Vec3f& x, int32_t medium, int paths) {
  RandomStream random(99, 1, 2, 3);
  RayCounters counters;
  double sum = 0;
  double squares = 0;
  for (int i = 0; i < paths; ++i) {
    scene::Hit hit;
    const auto sample = static_cast<double>(luminance(kernel.arriving_radiance(
        {x, square_to_uniform_sphere(random.next_vec2()), infinity}, medium, 2, random, counters, &hit)));
    sum += sample;
    squares += sample * sample;
  }
  const double mean = sum / paths;
  return {mean, std::sqrt(std::max(squares / paths - mean * mean, 0.0) / paths)};
}

/// Of all quantities that sources consist of.
class Makers {
 public:
  Makers(const std::shared_ptr<const transport::World>& world, const RecordMakerSettings& settings)
      : rest_(make_record_maker(Quantity::rest, world, settings)),
        irradiance_(make_record_maker(Quantity::irradiance, world, settings)) {}
  const RecordMaker& of(Quantity quantity) const {
    return quantity == Quantity::rest ? *rest_ : *irradiance_;
  }

 private:
  std::unique_ptr<RecordMaker> rest_;
  std::unique_ptr<RecordMaker> irradiance_;
};

/// Records of the generation below that of `wishes` around what these look at.
std::vector<Record> make_sources(const Makers& makers, std::span<const Wish> wishes, const Epoch* below,
                                 float spacing, double& seconds) {
  constexpr int32_t asked_for = 512;
  constexpr size_t most = 100000;
  RayCounters counters;
  std::map<Component, std::vector<SpacedWish>> by_component;
  for (const Wish& wish : wishes)
    for (const Wish& source : makers.of(wish.component.quantity).sources_of(wish, asked_for, counters))
      by_component[source.component].push_back({source, spacing});
  std::vector<Record> records;
  const double start = cpu_seconds();
  for (const auto& [component, sources] : by_component)
    for (const uint32_t i : thin(sources, 0, most))
      records.push_back(makers.of(component.quantity).make(sources[i].wish, below, counters));
  seconds = cpu_seconds() - start;
  return records;
}

MetricSettings metric_for(const transport::World& world, double floor) {
  const auto radius = static_cast<double>(world.scene().bounds.radius);
  MetricSettings metric;
  metric.threshold = 1e-4 * radius * radius * radius;
  metric.radiance_floor = std::max(floor, 1e-30);
  metric.maximum_radius = 0.3 * radius;
  metric.minimum_radius = spacing_radii * radius;
  return metric;
}

void measure(const std::shared_ptr<const transport::World>& world, std::span<const Vec3f> points, int seeds,
             int reference_paths, std::span<const int32_t> directions) {
  const transport::PathTracer kernel(world, {});
  std::vector<Reference> references;
  double floor = 0;
  const double reference_start = cpu_seconds();
  for (const Vec3f& x : points) {
    references.push_back(path_traced(kernel, x, world->medium_at(x), reference_paths));
    floor += 0.05 * references.back().mean / static_cast<double>(points.size());
  }
  double reference_error = 0;
  for (const Reference& reference : references)
    reference_error += reference.standard_error / reference.mean / static_cast<double>(references.size());
  std::cout << nlohmann::json{{"reference_paths", reference_paths},
                              {"reference_error", reference_error},
                              {"seconds",
                               (cpu_seconds() - reference_start) / static_cast<double>(points.size())}}
            << std::endl;

  const Makers source_makers(world, {.samples = 256});
  std::unique_ptr<const Epoch> epoch;
  constexpr uint8_t generations = 3;
  const auto spacing = static_cast<float>(spacing_radii) * world->scene().bounds.radius;
  for (uint8_t generation = 0; generation < generations; ++generation) {
    const auto wish_at = [&](const Vec3f& x) {
      return Wish{x, Vec3f(0), {world->medium_at(x), 0, generation, Quantity::rest}};
    };
    for (const int32_t count : directions) {
      double error = 0;
      double noise = 0;
      double stated = 0;
      double seconds = 0;
      double rays = 0;
      double bias = 0;
      for (size_t i = 0; i < points.size(); ++i) {
        double sum = 0;
        double squares = 0;
        double variance = 0;
        for (int seed = 0; seed < seeds; ++seed) {
          const std::unique_ptr<RecordMaker> maker = make_record_maker(
              Quantity::rest, world, {.samples = count, .seed = static_cast<uint64_t>(seed + 1)});
          RayCounters counters;
          const double start = cpu_seconds();
          const Record record = maker->make(wish_at(points[i]), epoch.get(), counters);
          seconds += cpu_seconds() - start;
          rays += static_cast<double>(counters.total());
          const double value = static_cast<double>(luminance(record.radiance)) / references[i].mean;
          sum += value;
          squares += (value - 1) * (value - 1);
          variance += static_cast<double>(record.variance) / (references[i].mean * references[i].mean);
        }
        const double mean = sum / seeds;
        error += squares / seeds;
        bias += (mean - 1) * (mean - 1);
        noise += squares / seeds - (mean - 1) * (mean - 1);
        stated += variance / seeds;
      }
      const auto n = static_cast<double>(points.size());
      std::cout
          << nlohmann::json{{"generation", generation},          {"directions", count},
                            {"rms_error", std::sqrt(error / n)}, {"rms_bias", std::sqrt(bias / n)},
                            {"rms_noise", std::sqrt(noise / n)}, {"stated_noise", std::sqrt(stated / n)},
                            {"seconds", seconds / (n * seeds)},  {"rays", rays / (n * seeds)}}
          << std::endl;
    }
    if (generation + 1 == generations) break;
    // Sources of the next generation: this one's records, read from those made before.
    std::vector<Wish> wishes;
    for (const Vec3f& x : points) {
      Wish wish = wish_at(x);
      ++wish.component.scattering_order;
      wishes.push_back(wish);
    }
    double seconds = 0;
    const std::vector<Record> records = make_sources(source_makers, wishes, epoch.get(), spacing, seconds);
    std::cout << nlohmann::json{{"sources_of_generation", generation + 1},
                                {"records", records.size()},
                                {"seconds", seconds / static_cast<double>(records.size())}}
              << std::endl;
    std::vector<Record> all = records;
    if (epoch)
      for (size_t i = 0; i < epoch->records().size(); ++i) all.push_back(epoch->records().record(i));
    epoch = std::make_unique<const Epoch>(std::make_shared<const RecordSet>(std::move(all)),
                                          metric_for(*world, floor));
  }
}

int main_with(std::span<char*> arguments) {
  if (arguments.size() < 6) {
    std::cerr << "generations_bench SCENE.xml POINTS SEEDS REFERENCE_PATHS DIRECTIONS...\n";
    return 2;
  }
  scene::prepare_render_thread();
  const std::filesystem::path file(arguments[1]);
  const auto world = std::make_shared<const transport::World>(
      scene::load_scene(file.filename(), scene::folder_source(file.parent_path()), {}));
  std::vector<int32_t> directions;
  for (const char* argument : arguments.subspan(5)) directions.push_back(std::stoi(argument));
  measure(world, points_in_view(*world, std::stoi(arguments[2])), std::stoi(arguments[3]),
          std::stoi(arguments[4]), directions);
  return 0;
}

}  // namespace
}  // namespace fogbank::cache

int main(int argc, char** argv) { return fogbank::cache::main_with({argv, static_cast<size_t>(argc)}); }
