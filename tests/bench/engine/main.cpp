// fogbank_bench: the engine without the service, for measurements. Reads one JSON command a line from
// standard input and answers each with one JSON line; tests/bench/run.py drives it.
//
//   {"command": "load", "scene": path, "parameters": {name: text}}
//   {"command": "render", "width", "height", "samples_per_pixel", "max_depth", "seed", "threads", "output":
//   path, "integrator": "volpath", "error": 0, "time_budget_seconds": 0, "record_budget": 0, "reference":
//   path of an EXR file, "aovs": [], "single_scattering": "auto", "keep_cache": false}
//
// With `keep_cache` records stay for renderings of the same scene that have it too.
// `render` takes the reconstruction filter box whatever the scene says, since Mitsuba weights the samples of
// neighbouring pixels with any other, and its pixels are not independent then. `output` is an EXR file of
// floats.
#include <dlfcn.h>
#include <sys/resource.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "../embree_probe.h"
#include "cache/scene_cache.h"
#include "render/exr.h"
#include "render/exr_reader.h"
#include "render/render_to_image.h"
#include "scene/loader.h"
#include "transport/world.h"

namespace fogbank {
namespace {

using Json = nlohmann::json;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

class Bench {
 public:
  Json answer(const Json& command) {
    const auto name = command.at("command").get<std::string>();
    if (name == "load") return load(command);
    if (name == "render") return render(command);
    throw std::runtime_error("unknown command " + name);
  }

 private:
  Json load(const Json& command) {
    const std::filesystem::path path = command.at("scene").get<std::string>();
    scene::LoadOptions options;
    options.parameters = command.value("parameters", std::map<std::string, std::string>{});
    world_.reset();
    auto start = std::chrono::steady_clock::now();
    auto scene = scene::load_scene(path.filename(), scene::folder_source(path.parent_path()), options);
    const double load_seconds = seconds_since(start);
    const scene::LoadTimes times = scene->load_times;
    start = std::chrono::steady_clock::now();
    world_ = std::make_shared<transport::World>(std::move(scene));
    cache_ = std::make_shared<cache::SceneCache>();
    return {{"load_seconds", load_seconds},
            {"parse_seconds", times.parse},
            {"mesh_seconds", times.meshes},
            {"texture_seconds", times.textures},
            {"acceleration_seconds", times.acceleration},
            {"world_seconds", seconds_since(start)},
            {"triangles", world_->scene().triangle_count()}};
  }

  Json render(const Json& command) {
    if (!world_) throw std::runtime_error("load a scene first");
    render::RenderSettings settings;
    settings.sensor = world_->scene().sensor;
    settings.film.width = command.at("width");
    settings.film.height = command.at("height");
    settings.film.crop = {0, 0, settings.film.width, settings.film.height};
    settings.film.filter = scene::ReconstructionFilter::box;
    settings.film.filter_radius = 0.5f;
    settings.samples_per_pixel = command.at("samples_per_pixel");
    settings.integrator_settings.max_depth = command.at("max_depth");
    settings.integrator_settings.rr_depth = world_->scene().defaults.rr_depth;
    settings.integrator_settings.hide_emitters = world_->scene().defaults.hide_emitters;
    settings.seed = command.at("seed");
    settings.integrator = command.value("integrator", settings.integrator);
    settings.error = command.value("error", settings.error);
    settings.time_budget_seconds = command.value("time_budget_seconds", settings.time_budget_seconds);
    settings.record_budget = command.value("record_budget", settings.record_budget);
    settings.integrator_settings.single_scattering =
        render::parse_single_scattering(command.value("single_scattering", std::string("auto")));
    if (command.value("keep_cache", false)) settings.integrator_settings.cache = cache_;
    for (const std::string& aov : command.value("aovs", std::vector<std::string>{})) {
      settings.aovs.push_back(render::parse_aov(aov));
    }
    if (const auto path = command.value("reference", std::string()); !path.empty()) {
      std::ifstream file(path, std::ios::binary);
      const std::string bytes(std::istreambuf_iterator<char>(file), {});
      settings.reference = std::make_shared<render::ReferenceImage>(
          render::ReferenceImage{settings.film.crop, render::decode_rgb(bytes, settings.film.crop)});
    }
    render::RenderJob job(world_, settings);
    const auto take = reinterpret_cast<EmbreeProbeTake*>(dlsym(RTLD_DEFAULT, embree_probe_take_name));
    EmbreeProbe probe;
    if (take != nullptr) take(&probe);  // what was counted before
    render::run_to_completion(job, command.at("threads"));
    const render::Progress progress = job.progress();
    rusage usage{};
    getrusage(RUSAGE_SELF, &usage);
    Json answer{{"cpu_seconds", progress.cpu_seconds},
                {"peak_bytes", int64_t{usage.ru_maxrss} * 1024},
                {"wall_seconds", progress.render_seconds},
                {"samples", progress.samples_done},
                {"rays", progress.rays},
                {"passes", progress.passes_done},
                {"invalid_samples", progress.invalid_samples},
                {"stage", progress.stage},
                {"stage_error", progress.stage_error},
                {"epoch", progress.epoch},
                {"records_reused", progress.records_reused},
                {"records_new", progress.records_new},
                {"bias", progress.estimate.bias}};
    answer["history"] = Json::parse(describe(settings, progress, job.history(), "").at("fogbank:history"));
    if (progress.estimate.error) answer["estimated_error"] = *progress.estimate.error;
    if (progress.estimate.noise) answer["relative_noise"] = *progress.estimate.noise;
    if (take != nullptr) {
      take(&probe);
      answer["embree"] = {{"rays", probe.rays},
                          {"seconds", probe.seconds},
                          {"replayed_rays", probe.replayed_rays},
                          {"replay_seconds", probe.replay_seconds}};
    }
    if (const auto output = command.value("output", std::string()); !output.empty()) {
      const std::string bytes = encode_image(job.image(), render::PixelType::single_float, false, {});
      if (!(std::ofstream(output, std::ios::binary) << bytes))
        throw std::runtime_error("can't write " + output);
    }
    return answer;
  }

  std::shared_ptr<const transport::World> world_;
  std::shared_ptr<cache::SceneCache> cache_;
};

}  // namespace
}  // namespace fogbank

int main() {
  fogbank::Bench bench;
  std::string line;
  while (std::getline(std::cin, line)) {
    fogbank::Json answer;
    try {
      answer = bench.answer(fogbank::Json::parse(line));
    } catch (const std::exception& error) {
      answer = {{"error", error.what()}};
    }
    std::cout << answer.dump() << std::endl;
  }
}
