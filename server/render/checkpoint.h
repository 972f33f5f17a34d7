// The film of a job between two passes, in a file, so that a job whose program died goes on from there.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "render/film.h"
#include "render/progress.h"
#include "render/progression.h"

namespace fogbank::render {

/// What the passes since the last stage see of the cache. The records themselves lie in the cache's folder.
struct CachedStage {
  std::vector<uint64_t> records;  ///< ids of all that the job has, those of others that it began with, too
  std::string integrator;         ///< Integrator::state
  std::string survey;             ///< of what the cache says about pixels; empty: none was made
  double reserved_seconds = 0;    ///< of a time budget, for AOVs; >= 0
};

/// A job as after a finished pass; or, with no pass and no tile, one with a cache as it begins: of `stage` it
/// has `records` alone.
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
  Progression::State progression;
  std::shared_ptr<const CachedStage> stage;  ///< null: the film has no cached layer
};

/// Writes `path` durably, under its name only when it is whole. `identity` names everything that the film
/// depends on besides the number of samples and the cache's records: scene, settings, build. Takes, on one
/// core, about a second for 2 GB, plus what the disk needs; no memory to speak of. Throws as
/// `write_file_durably`.
void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint,
                      const std::string& identity);

/// Throws Error: data_loss CHECKPOINT_DAMAGED for a file that is not whole, has a bit changed, or is of
/// another identity or version; and as `read_file`.
Checkpoint read_checkpoint(const std::filesystem::path& path, const std::string& identity);

}  // namespace fogbank::render
