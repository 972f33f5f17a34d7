#include "service/tile_source.h"

#include <algorithm>
#include <utility>

#include "core/files.h"
#include "core/sha256.h"
#include "render/exr_reader.h"
#include "render/tiles.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace {

scene::Window to_engine(const v1::Window& window) {
  return {window.x(), window.y(), window.width(), window.height()};
}

class FilmTiles : public TileSource {
 public:
  explicit FilmTiles(std::shared_ptr<const render::RenderJob> job) : job_(std::move(job)) {}
  render::TilePixels tile(uint32_t index) const override { return job_->tile(index); }

 private:
  std::shared_ptr<const render::RenderJob> job_;
};

class StoredTiles : public TileSource {
 public:
  StoredTiles(std::vector<float> rgb, const v1::Job& job)
      : rgb_(std::move(rgb)),
        window_(to_engine(job.settings().crop())),
        grid_(window_, job.settings().tile_size()),
        passes_(static_cast<uint32_t>(job.progress().passes_done())),
        samples_(static_cast<uint32_t>(job.result().samples_per_pixel())) {}

  render::TilePixels tile(uint32_t index) const override {
    render::TilePixels tile{.window = grid_.window(index), .pass = passes_, .samples = samples_, .rgb = {}};
    const auto row_values = static_cast<size_t>(tile.window.width) * 3;
    tile.rgb.resize(row_values * static_cast<size_t>(tile.window.height));
    for (int32_t row = 0; row < tile.window.height; ++row) {
      const auto image_row = static_cast<size_t>(tile.window.y - window_.y + row);
      const auto image_column = static_cast<size_t>(tile.window.x - window_.x);
      const float* from = rgb_.data() + (image_row * static_cast<size_t>(window_.width) + image_column) * 3;
      std::copy_n(from, row_values, tile.rgb.data() + static_cast<size_t>(row) * row_values);
    }
    return tile;
  }

 private:
  std::vector<float> rgb_;
  scene::Window window_;
  render::TileGrid grid_;
  uint32_t passes_;
  uint32_t samples_;
};

}  // namespace

std::shared_ptr<const TileSource> film_tiles(std::shared_ptr<const render::RenderJob> job) {
  return std::make_shared<FilmTiles>(std::move(job));
}

std::shared_ptr<const TileSource> stored_tiles(const std::filesystem::path& image, const v1::Job& job) {
  try {
    const std::string file = read_file(image, job.result().image_bytes());
    if (sha256(file) != job.result().image_sha256())
      throw Error(ErrorKind::data_loss, "IMAGE_DAMAGED", "wrong hash");
    return std::make_shared<StoredTiles>(render::decode_rgb(file, to_engine(job.settings().crop())), job);
  } catch (const std::exception& error) {
    throw RpcError(grpc::StatusCode::DATA_LOSS, "IMAGE_DAMAGED",
                   "the stored image of " + job.name() + " can't be used: " + error.what(),
                   {{"name", job.name()}});
  }
}

uint32_t tile_count(const v1::CreateJobRequest& request, const v1::RenderSettings& effective) {
  if (request.fill_only()) return 0;
  return render::TileGrid(to_engine(effective.crop()), effective.tile_size()).count();
}

}  // namespace fogbank::service
