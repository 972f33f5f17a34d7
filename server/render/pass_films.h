// The tiles of a film, pass after pass. A tile's film is an immutable object: a task makes the next one
// beside it and swaps it in, so what is read is never torn and readers wait for no renderer. Not thread-safe:
// the job's mutex guards it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "render/film.h"
#include "render/render_settings.h"
#include "render/task.h"
#include "render/tiles.h"

namespace fogbank::render {

using TileFilmPointer = std::shared_ptr<const TileFilm>;

class PassFilms {
 public:
  explicit PassFilms(const RenderSettings& settings);

  const TileGrid& grid() const { return grid_; }
  uint32_t passes_done() const { return passes_done_; }
  uint32_t samples_done() const { return samples_done_; }  ///< per pixel, of finished passes
  uint32_t tiles_done() const { return tiles_done_; }      ///< of the current pass
  uint64_t pixel_samples_done() const { return samples_done_ * crop_pixels_ + pixels_done_ * pass_samples_; }
  uint32_t first_cached_sample() const { return first_cached_sample_; }
  /// The cached layer begins anew with the next pass.
  void restart_cached() { first_cached_sample_ = samples_done_; }

  /// The first `cached_samples` of its samples look at the cache, if there is one.
  void begin_pass(uint32_t samples, uint32_t cached_samples);
  /// A task of the current pass that nobody has, if any.
  std::optional<TileTask> take();
  void give_back(uint32_t tile) { returned_.push_back(tile); }
  /// Whoever took tasks has gone: those that aren't done can be taken again.
  void recall();
  /// The present pass's task of a tile.
  TileTask task(uint32_t tile) const;
  /// Was such a task ever handed out?
  bool knows(const TileTask& task) const;
  bool is_done(const TileTask& task) const;
  /// True when that completed the pass. Gives back what memory was replaced, to be freed without the mutex.
  bool add(const TileTask& task, TileFilmPointer film, TileFilmPointer& outdated);
  /// Before the first pass: the films of so many passes that are finished already; at least one tile.
  void resume(uint32_t passes, uint32_t samples, const std::vector<TileFilmPointer>& films);
  /// Tiles that are ahead of the last finished pass fall back to it; no task is handed out any more.
  void drop_unfinished_pass();

  TileFilmPointer current(uint32_t tile) const { return tiles_[tile].current; }
  /// By tile, as after the last finished pass; null before the first.
  std::vector<TileFilmPointer> finished() const;

 private:
  struct Tile {
    TileFilmPointer current;   ///< null before the first pass
    TileFilmPointer finished;  ///< as after the last finished pass, kept while `current` is ahead of it
  };

  TileGrid grid_;
  std::vector<uint32_t> order_;
  uint64_t crop_pixels_;
  std::vector<Tile> tiles_;
  uint32_t passes_done_ = 0;
  uint32_t samples_done_ = 0;
  uint32_t first_cached_sample_ = 0;
  uint32_t pass_samples_ = 0;  ///< of the current pass; 0: there is none
  uint32_t pass_cached_samples_ = 0;
  size_t next_in_order_ = 0;
  std::vector<uint32_t> returned_;  ///< tiles of the current pass whose task was stopped
  uint32_t tiles_done_ = 0;
  uint64_t pixels_done_ = 0;  ///< of the current pass
};

}  // namespace fogbank::render
