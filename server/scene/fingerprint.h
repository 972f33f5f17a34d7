// Names of radiance fields.
#pragma once

#include <string>
#include <vector>

#include "scene/description.h"
#include "scene/field_identity.h"
#include "scene/scene_file_reader.h"

namespace fogbank::scene {

/// SHA-256, as 64 hexadecimal digits, over everything the radiance field depends on: shapes and emitters with
/// all that they refer to, files by content, and the medium that the camera is in, which fills the space that
/// no shape bounds. The rest of sensor, film, sampler and integrator is left out, as are ids, names of files,
/// objects that nothing refers to, and the order of elements and parameters. `objects` stand directly in the
/// scene.
std::string radiance_fingerprint(const std::vector<ObjectPointer>& objects, SceneFileReader& files);

/// `objects` as above, `media` and `emitters` in the order of their indices. Unlike the fingerprint above it
/// depends on the order of shapes, emitters and media, since cached records refer to indices.
FieldIdentity field_identity(const std::vector<ObjectPointer>& objects,
                             const std::vector<ObjectPointer>& media,
                             const std::vector<ObjectPointer>& emitters, SceneFileReader& files);

}  // namespace fogbank::scene
