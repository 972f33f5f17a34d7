// The film of a job between two passes, in a file, so that a job whose program died goes on from there.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "render/film.h"
#include "render/progress.h"

namespace fogbank::render {

/// A job as after a finished pass. It has no cached film layer: what that rests on is not in a file.
struct Checkpoint {
  uint32_t passes = 0;
  uint32_t samples = 0;                                ///< per pixel
  std::vector<std::shared_ptr<const TileFilm>> tiles;  ///< by index; shared with the job, never changed
  uint64_t rays = 0;
  uint64_t invalid_samples = 0;
  double render_seconds = 0;
  double cpu_seconds = 0;
  std::vector<HistoryEntry>
      history;  ///< of the passes before this one, about cached layers and references too
};

/// Writes `path` durably, under its name only when it is whole. `identity` names everything that the film
/// depends on besides the number of samples: scene, settings, build. Takes, on one core, about a second for
/// 2 GB, plus what the disk needs; no memory to speak of. Throws as `write_file_durably`.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      const std::string& identity);

/// Throws Error: data_loss CHECKPOINT_DAMAGED for a file that is not whole, has a bit changed, or is of
/// another identity or version; and as `read_file`.
Checkpoint read_checkpoint(const std::filesystem::path& path, const std::string& identity);

}  // namespace fogbank::render
