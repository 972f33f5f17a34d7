// Names of radiance fields.
#pragma once

#include <string>
#include <vector>

#include "scene/content_hashes.h"
#include "scene/description.h"

namespace fogbank::scene {

/// SHA-256, as 64 hexadecimal digits, over everything the radiance field depends on: shapes and emitters with
/// all that they refer to, files by content, and the medium that the camera is in, which fills the space that
/// no shape bounds. The rest of sensor, film, sampler and integrator is left out, as are ids, names of files,
/// objects that nothing refers to, and the order of elements and parameters. `objects` stand directly in the
/// scene.
std::string radiance_fingerprint(const std::vector<ObjectPointer>& objects, ContentHashes& hashes);

}  // namespace fogbank::scene
