// From the settings of a request to those of the engine, and to the effective ones that the job echoes.
#pragma once

#include <string>
#include <vector>

#include "fogbank/v1/cache.pb.h"
#include "fogbank/v1/render.pb.h"
#include "render/exr.h"
#include "render/render_job.h"
#include "scene/scene.h"

namespace fogbank::service {

/// Settings with every default filled in. The engine's cache and reference image are for the caller to set.
struct JobSettings {
  render::RenderSettings engine;
  v1::RenderSettings effective;
};

render::PixelType pixel_type(const v1::RenderSettings& effective);

/// Whether the integrator of this name reads and fills the scene's radiance cache.
bool uses_cache(const std::string& integrator);

/// Throws RpcError INVALID_SETTINGS, naming the field of the request, for whatever is out of range.
JobSettings resolve_settings(const v1::RenderSettings& requested, const scene::Scene& scene,
                             int server_threads);

struct FillSettings {
  render::RenderSettings engine;
  std::vector<scene::Sensor> cameras;  ///< at least one
};

/// Throws as `resolve_settings`, and RpcError TOO_MANY_CAMERAS.
FillSettings resolve_fill(const v1::FillCacheRequest& request, const scene::Scene& scene, int server_threads);

/// Of a job that makes no picture. Throws RpcError INVALID_SETTINGS.
void check_fill_only(const v1::CreateJobRequest& request, const v1::RenderSettings& effective);

}  // namespace fogbank::service
