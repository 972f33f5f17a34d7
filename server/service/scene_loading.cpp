#include "service/scene_loading.h"

#include <bit>
#include <map>
#include <set>

#include "cache/store/store.h"
#include "core/sha256.h"
#include "scene/loader.h"
#include "service/limits.h"
#include "service/messages.h"
#include "service/names.h"
#include "service/rpc_error.h"
#include "service/sandbox/sandboxed_files.h"
#include "service/scheduling/clock.h"

namespace fogbank::service {

using grpc::StatusCode;

namespace {

[[noreturn]] void refuse_manifest(const std::string& field, const std::string& message) {
  throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_MANIFEST", field + ": " + message,
                 {{"field", field}});
}

void check_options(const v1::LoadOptions& options) {
  if (options.parameters_size() > limits::max_parameters) {
    refuse_manifest("options.parameters",
                    "more than " + std::to_string(limits::max_parameters) + " parameters");
  }
}

scene::LoadOptions engine_options(const v1::LoadOptions& options) {
  return {.parameters = {options.parameters().begin(), options.parameters().end()},
          .lenient = options.lenient()};
}

/// Everything that a picture depends on: the radiance field, and the file's view of it.
std::string identify(const scene::Scene& scene) {
  Sha256 hash;
  auto add_text = [&](const std::string& text) {
    hash.update(std::to_string(text.size()) + ":");
    hash.update(text);
  };
  auto add = [&](double value) { add_text(std::to_string(std::bit_cast<uint64_t>(value))); };
  add_text("fogbank scene 2");
  add_text(scene.fingerprint);
  const scene::Sensor& sensor = scene.sensor;
  add(static_cast<double>(sensor.kind));
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row) add(sensor.to_world[column][row]);
  }
  add(static_cast<double>(sensor.fov_axis));
  for (const double value :
       {sensor.fov_degrees, sensor.near_clip, sensor.far_clip, sensor.aperture_radius, sensor.focus_distance,
        sensor.principal_point_offset.x, sensor.principal_point_offset.y}) {
    add(value);
  }
  add(sensor.medium);
  const scene::Film& film = scene.film;
  for (const int32_t value :
       {film.width, film.height, film.crop.x, film.crop.y, film.crop.width, film.crop.height}) {
    add(value);
  }
  add(static_cast<double>(film.filter));
  add(film.filter_radius);
  add(film.filter_stddev);
  const scene::RenderDefaults& defaults = scene.defaults;
  add_text(defaults.integrator);
  for (const int32_t value :
       {defaults.max_depth, defaults.rr_depth, defaults.samples_per_pixel, int32_t{defaults.hide_emitters}}) {
    add(value);
  }
  return hash.finish();
}

/// Geometry and acceleration structure; decoded images are not counted.
size_t memory_bytes(const scene::Scene& scene) {
  size_t bytes = scene.intersector ? scene.intersector->memory_bytes() : 0;
  for (const scene::Mesh& mesh : scene.meshes) {
    bytes += mesh.positions.size() * sizeof(mesh.positions[0]) +
             mesh.normals.size() * sizeof(mesh.normals[0]) + mesh.uvs.size() * sizeof(mesh.uvs[0]) +
             mesh.triangles.size() * sizeof(mesh.triangles[0]);
  }
  return bytes;
}

v1::Scene describe(const std::string& id, const scene::Scene& scene) {
  v1::Scene message;
  message.set_name(scene_name(id));
  message.set_radiance_fingerprint(scene.fingerprint);
  message.set_cache(cache_name(cache::record_field(scene, scene.defaults.max_depth).transport));
  *message.mutable_create_time() = timestamp_now();
  message.set_resident(true);
  v1::SceneStatistics& statistics = *message.mutable_statistics();
  statistics.set_triangles(static_cast<int64_t>(scene.triangle_count()));
  statistics.set_shapes(static_cast<int64_t>(scene.shapes.size()));
  statistics.set_lights(static_cast<int64_t>(scene.emitters.size()));
  statistics.set_media(static_cast<int64_t>(scene.media.size()));
  statistics.set_memory_bytes(static_cast<int64_t>(memory_bytes(scene)));
  v1::LoadTimes& times = *message.mutable_load_times();
  times.set_parse_seconds(scene.load_times.parse);
  times.set_meshes_seconds(scene.load_times.meshes);
  times.set_textures_seconds(scene.load_times.textures);
  times.set_bvh_seconds(scene.load_times.acceleration);
  for (const std::string& warning : scene.warnings) message.add_warnings(warning);
  v1::RenderDefaults& defaults = *message.mutable_defaults();
  defaults.set_width(scene.film.width);
  defaults.set_height(scene.film.height);
  defaults.mutable_crop()->set_x(scene.film.crop.x);
  defaults.mutable_crop()->set_y(scene.film.crop.y);
  defaults.mutable_crop()->set_width(scene.film.crop.width);
  defaults.mutable_crop()->set_height(scene.film.crop.height);
  defaults.set_integrator(scene.defaults.integrator);
  defaults.set_samples_per_pixel(scene.defaults.samples_per_pixel);
  defaults.set_max_depth(scene.defaults.max_depth);
  defaults.set_rr_depth(scene.defaults.rr_depth);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column)
      defaults.add_camera_to_world(scene.sensor.to_world[column][row]);
  }
  v1::BoundingSphere& bounds = *message.mutable_bounds();
  bounds.set_x(static_cast<double>(scene.bounds.center.x));
  bounds.set_y(static_cast<double>(scene.bounds.center.y));
  bounds.set_z(static_cast<double>(scene.bounds.center.z));
  bounds.set_radius(static_cast<double>(scene.bounds.radius));
  return message;
}

}  // namespace

void check_manifest(const v1::SceneManifest& manifest) {
  check_logical_path(manifest.main_path(), "main_path");
  if (manifest.entries_size() > limits::max_manifest_files) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "TOO_MANY_FILES",
                   std::to_string(manifest.entries_size()) + " files are above the limit of " +
                       std::to_string(limits::max_manifest_files),
                   {{"limit", "max_manifest_files"}});
  }
  std::set<std::string> paths;
  int64_t total = 0;
  for (int i = 0; i < manifest.entries_size(); ++i) {
    const v1::ManifestEntry& entry = manifest.entries(i);
    const std::string field = "entries[" + std::to_string(i) + "]";
    check_logical_path(entry.path(), field);
    try {
      check_sha256(entry.sha256());
    } catch (const RpcError& error) {
      refuse_manifest(field, error.what());
    }
    if (entry.size() < 0 || entry.size() > limits::max_blob_bytes) {
      refuse_manifest(field, "size must be 0 to " + std::to_string(limits::max_blob_bytes) + " bytes");
    }
    if (!paths.insert(entry.path()).second) refuse_manifest(field, "path is listed twice: " + entry.path());
    total += entry.size();
  }
  if (total > limits::max_scene_bytes) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "SCENE_TOO_LARGE",
                   "files of " + std::to_string(total) + " bytes are above the limit of " +
                       std::to_string(limits::max_scene_bytes),
                   {{"limit", "max_scene_bytes"}});
  }
  if (!paths.contains(manifest.main_path())) refuse_manifest("main_path", "is not among the entries");
  check_options(manifest.options());
}

void check_source(const v1::CreateSceneRequest& request,
                  const std::optional<std::filesystem::path>& scene_root) {
  switch (request.source_case()) {
    case v1::CreateSceneRequest::kManifest:
      check_manifest(request.manifest());
      return;
    case v1::CreateSceneRequest::kServerFile:
      if (!scene_root) {
        throw RpcError(StatusCode::FAILED_PRECONDITION, "NO_SCENE_ROOT",
                       "this server was started without --scene-root, so scenes must be uploaded");
      }
      try {
        check_logical_path(request.server_file().path(), "server_file.path");
      } catch (const RpcError& error) {
        throw RpcError(error.code(), "SCENE_PATH_REFUSED", error.what(), error.metadata());
      }
      check_options(request.server_file().options());
      return;
    case v1::CreateSceneRequest::SOURCE_NOT_SET:
      refuse_manifest("source", "neither manifest nor server_file is set");
  }
}

v1::PrepareSceneResponse find_missing(const v1::SceneManifest& manifest, BlobStore& blobs,
                                      ReaderHost& readers) {
  check_manifest(manifest);
  v1::PrepareSceneResponse response;
  std::map<std::string, std::string> present;
  std::set<std::string> listed;
  std::set<std::string> missing;
  for (const v1::ManifestEntry& entry : manifest.entries()) {
    listed.insert(entry.path());
    const auto presence = blobs.query(entry.sha256());
    if (!presence.complete) {
      if (missing.insert(entry.sha256()).second) response.add_missing_blobs(entry.sha256());
      continue;
    }
    if (presence.committed_size != entry.size()) {
      refuse_manifest(entry.path(), "the blob of this hash has " + std::to_string(presence.committed_size) +
                                        " bytes, not " + std::to_string(entry.size()));
    }
    present.emplace(entry.path(), blobs.find(entry.sha256())->path.string());
  }
  if (!present.contains(manifest.main_path())) return response;
  std::set<std::string> unlisted;
  SandboxedFiles files(readers, scene::blob_source(std::move(present)));
  for (const std::string& path : files.references(manifest.main_path(), engine_options(manifest.options()))) {
    if (!listed.contains(path) && unlisted.insert(path).second) response.add_unlisted_paths(path);
  }
  return response;
}

LoadedScene load(const v1::CreateSceneRequest& request,
                 const std::optional<std::filesystem::path>& scene_root, BlobStore& blobs,
                 ReaderHost& readers) {
  const bool uploaded = request.has_manifest();
  int64_t file_bytes = 0;
  std::shared_ptr<const scene::StoredFiles> stored;
  if (uploaded) {
    std::map<std::string, std::string> paths;
    for (const v1::ManifestEntry& entry : request.manifest().entries()) {
      const auto blob = blobs.find_intact(entry.sha256());
      if (!blob || blob->size != entry.size()) {
        throw RpcError(StatusCode::FAILED_PRECONDITION, "BLOBS_MISSING",
                       "the contents of " + entry.path() + " are not uploaded",
                       {{"path", entry.path()}, {"sha256", entry.sha256()}});
      }
      paths.emplace(entry.path(), blob->path.string());
      file_bytes += entry.size();
    }
    stored = scene::blob_source(std::move(paths));
  } else {
    stored = scene::folder_source(scene_root->string());
  }
  const std::string& main_path = uploaded ? request.manifest().main_path() : request.server_file().path();
  const v1::LoadOptions& options = uploaded ? request.manifest().options() : request.server_file().options();

  const Clock::time_point start = Clock::now();
  LoadedScene loaded;
  const auto files = std::make_shared<SandboxedFiles>(readers, std::move(stored));
  const std::shared_ptr<scene::Scene> scene = scene::load_scene(main_path, files, engine_options(options));
  loaded.world = std::make_shared<const transport::World>(scene);
  files->close();
  loaded.id = identify(*scene);
  loaded.description = describe(loaded.id, *scene);
  loaded.description.set_main_path(main_path);
  loaded.description.mutable_statistics()->set_file_bytes(file_bytes);
  loaded.description.mutable_load_times()->set_total_seconds(to_seconds(Clock::now() - start));
  return loaded;
}

}  // namespace fogbank::service
