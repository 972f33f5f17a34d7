#include "render/pass_films.h"

#include <utility>

namespace fogbank::render {

PassFilms::PassFilms(const RenderSettings& settings)
    : grid_(settings.film.crop, settings.tile_size),
      order_(visiting_order(grid_, settings.tile_order, settings.first_region)),
      crop_pixels_(static_cast<uint64_t>(settings.film.crop.width) *
                   static_cast<uint64_t>(settings.film.crop.height)),
      tiles_(grid_.count()),
      next_in_order_(order_.size()) {}

void PassFilms::begin_pass(uint32_t samples, uint32_t cached_samples) {
  pass_samples_ = samples;
  pass_cached_samples_ = cached_samples;
  next_in_order_ = 0;
}

std::optional<TileTask> PassFilms::take() {
  uint32_t tile = 0;
  if (!returned_.empty()) {
    tile = returned_.back();
    returned_.pop_back();
  } else if (next_in_order_ < order_.size()) {
    tile = order_[next_in_order_++];
  } else {
    return std::nullopt;
  }
  return task(tile);
}

TileTask PassFilms::task(uint32_t tile) const {
  return {.tile = tile,
          .pass = passes_done_,
          .window = grid_.window(tile),
          .first_sample = samples_done_,
          .sample_count = pass_samples_,
          .first_cached_sample = first_cached_sample_,
          .cached_sample_count = pass_cached_samples_};
}

void PassFilms::recall() {
  returned_.clear();
  for (size_t i = next_in_order_; i-- > 0;)
    if (!is_done(task(order_[i]))) returned_.push_back(order_[i]);
}

bool PassFilms::knows(const TileTask& task) const {
  return task.tile < tiles_.size() && task.pass <= passes_done_;
}

bool PassFilms::is_done(const TileTask& task) const {
  const TileFilmPointer& film = tiles_[task.tile].current;
  return pass_samples_ == 0 || task.pass < passes_done_ || (film && film->passes > task.pass);
}

bool PassFilms::add(const TileTask& task, TileFilmPointer film, TileFilmPointer& outdated) {
  Tile& tile = tiles_[task.tile];
  outdated = std::exchange(tile.finished, std::exchange(tile.current, std::move(film)));
  pixels_done_ += tile.current->sampled.size();
  if (++tiles_done_ < tiles_.size()) return false;
  tiles_done_ = 0;
  pixels_done_ = 0;
  ++passes_done_;
  samples_done_ += std::exchange(pass_samples_, 0u);
  return true;
}

void PassFilms::resume(uint32_t passes, uint32_t samples, const std::vector<TileFilmPointer>& films) {
  for (size_t index = 0; index < films.size(); ++index) tiles_[index].current = films[index];
  passes_done_ = passes;
  samples_done_ = samples;
  first_cached_sample_ = films.front()->first_cached_sample;
}

void PassFilms::drop_unfinished_pass() {
  for (Tile& tile : tiles_) {
    if (tile.current && tile.current->passes > passes_done_) tile.current = tile.finished;
    tile.finished = nullptr;
  }
  tiles_done_ = 0;
  pixels_done_ = 0;
  pass_samples_ = 0;
  returned_.clear();
  next_in_order_ = order_.size();
}

std::vector<TileFilmPointer> PassFilms::finished() const {
  std::vector<TileFilmPointer> films;
  films.reserve(tiles_.size());
  for (const Tile& tile : tiles_) {
    films.push_back(tile.current && tile.current->passes > passes_done_ ? tile.finished : tile.current);
  }
  return films;
}

}  // namespace fogbank::render
