// From the settings of a request to those of the engine, and to the effective ones that the job echoes.
#pragma once

#include "fogbank/v1/render.pb.h"
#include "render/exr.h"
#include "render/render_job.h"
#include "scene/scene.h"

namespace fogbank::service {

/// Settings with every default filled in.
struct JobSettings {
  render::RenderSettings engine;
  v1::RenderSettings effective;
};

render::PixelType pixel_type(const v1::RenderSettings& effective);

/// Throws RpcError INVALID_SETTINGS, naming the field of the request, for whatever is out of range.
JobSettings resolve_settings(const v1::RenderSettings& requested, const scene::Scene& scene,
                             int server_threads);

}  // namespace fogbank::service
