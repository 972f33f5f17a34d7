// Where the pixels of a job's tiles come from: the film while the job is alive, the final image later.
#pragma once

#include <filesystem>
#include <memory>

#include "fogbank/v1/render.pb.h"
#include "render/render_job.h"

namespace fogbank::service {

/// Thread-safe.
class TileSource {
 public:
  virtual ~TileSource() = default;
  /// Tile `index`, row by row, as it is now.
  virtual render::TilePixels tile(uint32_t index) const = 0;
};

std::shared_ptr<const TileSource> film_tiles(std::shared_ptr<const render::RenderJob> job);

/// Tiles of the final image of a job that succeeded. Throws RpcError DATA_LOSS (IMAGE_DAMAGED) when the file
/// is not what the job says.
std::shared_ptr<const TileSource> stored_tiles(const std::filesystem::path& image, const v1::Job& job);

/// Number of tiles of a job.
uint32_t tile_count(const v1::CreateJobRequest& request, const v1::RenderSettings& effective);

}  // namespace fogbank::service
