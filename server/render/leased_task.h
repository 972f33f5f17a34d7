// Tasks of a job that others perform, and what they send back, as bytes between processes of the same build.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "render/film.h"
#include "render/render_settings.h"
#include "render/task.h"

namespace fogbank::render {

enum class LeasedKind : uint8_t { preparation, survey, tile };

/// Named by stage and index.
struct LeasedTask {
  uint32_t stage = 0;
  uint32_t index = 0;
  LeasedKind kind = LeasedKind::tile;
  std::string input;  ///< of TaskInput
};

struct TaskResult {
  std::string bytes;
  uint64_t rays = 0;
  uint64_t invalid_samples = 0;
  double seconds = 0;  ///< wall
  double cpu_seconds = 0;
};

struct PreparationInput {
  uint32_t task = 0;
};

struct SurveyInput {
  int32_t stride = 1;  ///< >= 1
  std::vector<Aov> channels;
  uint32_t row = 0;
};

struct TileInput {
  TileTask task;
  TileFilm film;  ///< as before the task, ready for its samples
};

/// What a replica must know of a task besides the log.
struct TaskInput {
  uint32_t step = 0;  ///< of the log: steps that are replayed before
  std::variant<PreparationInput, SurveyInput, TileInput> what;
};

std::string bytes_of(const TaskInput& input);
/// Throws Error(invalid_argument, "INVALID_TASK").
TaskInput task_input(std::string_view bytes);

/// The sums of a tile's film.
std::string bytes_of(const TileFilm& film);
/// The film that `before` has become by `task`. Throws Error(invalid_argument, "POISONED_RESULT") unless size
/// and sample numbers are right and every sum is finite and not negative.
TileFilm film_after(const TileTask& task, FilmLayers layers, std::string_view bytes);

/// The film that a task adds its samples to: `before` (null: black) with the layers that it needs.
TileFilm film_for(const TileTask& task, FilmLayers layers, const TileFilm* before);

}  // namespace fogbank::render
