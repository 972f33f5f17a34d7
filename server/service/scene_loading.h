// From a CreateScene request to a scene that can be rendered.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "fogbank/v1/scene.pb.h"
#include "service/blob_store.h"
#include "service/sandbox/reader_host.h"
#include "transport/world.h"

namespace fogbank::service {

/// A loaded scene with its description for clients.
struct LoadedScene {
  std::string id;  ///< the digits of its name
  v1::Scene description;
  std::shared_ptr<const transport::World> world;
};

/// Checks paths, hashes, sizes, counts and that the main file is listed. Throws RpcError INVALID_MANIFEST,
/// TOO_MANY_FILES, SCENE_TOO_LARGE.
void check_manifest(const v1::SceneManifest& manifest);

/// Checks `source` of the request. Throws as `check_manifest`, and SCENE_PATH_REFUSED, NO_SCENE_ROOT.
void check_source(const v1::CreateSceneRequest& request,
                  const std::optional<std::filesystem::path>& scene_root);

/// What the server lacks for the manifest. Throws as `check_manifest`, scene::list_references and
/// SandboxedFiles.
v1::PrepareSceneResponse find_missing(const v1::SceneManifest& manifest, BlobStore& blobs,
                                      ReaderHost& readers);

/// Loads the scene of a request that `check_source` accepts. Takes seconds. Throws RpcError BLOBS_MISSING and
/// as scene::load_scene and SandboxedFiles.
LoadedScene load(const v1::CreateSceneRequest& request,
                 const std::optional<std::filesystem::path>& scene_root, BlobStore& blobs,
                 ReaderHost& readers);

}  // namespace fogbank::service
