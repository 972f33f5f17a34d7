#include "render/leased_task.h"

#include <cmath>
#include <cstring>
#include <type_traits>

#include "cache/record_bytes.h"
#include "core/error.h"

namespace fogbank::render {

using cache::append_bytes;
using cache::ByteReader;
using cache::refuse_poisoned;

static_assert(sizeof(PixelSums) == 6 * sizeof(double) && std::is_trivially_copyable_v<PixelSums>);

namespace {

constexpr uint8_t greatest_aov = static_cast<uint8_t>(Aov::bias);

size_t pixel_count(const scene::Window& window) {
  return static_cast<size_t>(window.width) * static_cast<size_t>(window.height);
}

void append_layer(std::string& bytes, const std::vector<PixelSums>& layer) {
  append_bytes(bytes, static_cast<uint32_t>(layer.size()));
  bytes.append(reinterpret_cast<const char*>(layer.data()), layer.size() * sizeof(PixelSums));
}

std::vector<PixelSums> take_layer(ByteReader& reader) {
  const uint32_t count = cache::take_count(reader, sizeof(PixelSums));
  std::vector<PixelSums> layer(count);
  const std::string_view sums = reader.take(count * sizeof(PixelSums));
  if (count > 0) std::memcpy(static_cast<void*>(layer.data()), sums.data(), sums.size());
  for (const PixelSums& pixel : layer) {
    for (const Vec3d* half : {&pixel.even, &pixel.odd})
      for (int channel = 0; channel < 3; ++channel)
        if (!std::isfinite((*half)[channel]) || (*half)[channel] < 0)
          refuse_poisoned("a sum of samples is not finite or is negative");
  }
  return layer;
}

TileFilm take_film(ByteReader& reader) {
  TileFilm film;
  film.passes = reader.take<uint32_t>();
  film.samples = reader.take<uint32_t>();
  film.first_cached_sample = reader.take<uint32_t>();
  film.cached_samples.even = reader.take<uint32_t>();
  film.cached_samples.odd = reader.take<uint32_t>();
  film.sampled = take_layer(reader);
  film.cached = take_layer(reader);
  film.narrow = take_layer(reader);
  return film;
}

TileInput take_tile(ByteReader& reader) {
  TileInput input;
  TileTask& task = input.task;
  task.tile = reader.take<uint32_t>();
  task.pass = reader.take<uint32_t>();
  task.window.x = reader.take<int32_t>();
  task.window.y = reader.take<int32_t>();
  task.window.width = reader.take<int32_t>();
  task.window.height = reader.take<int32_t>();
  task.first_sample = reader.take<uint32_t>();
  task.sample_count = reader.take<uint32_t>();
  task.first_cached_sample = reader.take<uint32_t>();
  task.cached_sample_count = reader.take<uint32_t>();
  FilmLayers layers;
  layers.cached = reader.take<uint8_t>() != 0;
  layers.narrow = reader.take<uint8_t>() != 0;
  const auto is_side = [](int32_t side) { return side >= 1 && side <= RenderLimits::largest_tile; };
  const auto is_place = [](int32_t place) { return place >= 0 && place < RenderLimits::film_side; };
  constexpr auto most = static_cast<uint32_t>(RenderLimits::samples_per_pixel);
  if (!reader.ok() || !is_side(task.window.width) || !is_side(task.window.height) ||
      !is_place(task.window.x) || !is_place(task.window.y) || task.first_sample > most ||
      task.sample_count > most || task.first_cached_sample > task.first_sample ||
      task.cached_sample_count > task.sample_count)
    refuse_poisoned("a tile is out of range");
  const bool begun = reader.take<uint8_t>() != 0;
  TileFilm before;
  if (begun) before = take_film(reader);
  const size_t pixels = pixel_count(task.window);
  if (begun && (before.sampled.size() != pixels ||
                (!before.cached.empty() && (!layers.cached || before.cached.size() != pixels)) ||
                before.narrow.size() != (layers.narrow ? pixels : 0)))
    refuse_poisoned("a film has not the size of its tile");
  input.film = film_for(task, layers, begun ? &before : nullptr);
  return input;
}

SurveyInput take_survey(ByteReader& reader) {
  SurveyInput input;
  input.stride = reader.take<int32_t>();
  input.row = reader.take<uint32_t>();
  input.channels.resize(cache::take_count(reader, 1));
  for (Aov& channel : input.channels) {
    const auto number = reader.take<uint8_t>();
    if (number > greatest_aov) refuse_poisoned("there is no such channel");
    channel = static_cast<Aov>(number);
  }
  if (!reader.ok() || input.stride < 1 || input.channels.size() > greatest_aov + size_t{1})
    refuse_poisoned("a survey is out of range");
  return input;
}

void append(std::string& bytes, const PreparationInput& input) { append_bytes(bytes, input.task); }

void append(std::string& bytes, const SurveyInput& input) {
  append_bytes(bytes, input.stride);
  append_bytes(bytes, input.row);
  append_bytes(bytes, static_cast<uint32_t>(input.channels.size()));
  for (const Aov channel : input.channels) append_bytes(bytes, static_cast<uint8_t>(channel));
}

void append(std::string& bytes, const TileInput& input) {
  const TileTask& task = input.task;
  append_bytes(bytes, task.tile);
  append_bytes(bytes, task.pass);
  append_bytes(bytes, task.window.x);
  append_bytes(bytes, task.window.y);
  append_bytes(bytes, task.window.width);
  append_bytes(bytes, task.window.height);
  append_bytes(bytes, task.first_sample);
  append_bytes(bytes, task.sample_count);
  append_bytes(bytes, task.first_cached_sample);
  append_bytes(bytes, task.cached_sample_count);
  append_bytes(bytes, static_cast<uint8_t>(!input.film.cached.empty()));
  append_bytes(bytes, static_cast<uint8_t>(!input.film.narrow.empty()));
  // A film without samples is black, and a layer without samples needs no bytes.
  const bool begun = input.film.samples > 0;
  append_bytes(bytes, static_cast<uint8_t>(begun));
  if (!begun) return;
  append_bytes(bytes, input.film.passes);
  append_bytes(bytes, input.film.samples);
  append_bytes(bytes, input.film.first_cached_sample);
  append_bytes(bytes, input.film.cached_samples.even);
  append_bytes(bytes, input.film.cached_samples.odd);
  append_layer(bytes, input.film.sampled);
  append_layer(bytes,
               task.first_cached_sample < task.first_sample ? input.film.cached : std::vector<PixelSums>{});
  append_layer(bytes, input.film.narrow);
}

}  // namespace

TileFilm film_for(const TileTask& task, FilmLayers layers, const TileFilm* before) {
  TileFilm film;
  if (before != nullptr) film = *before;
  const size_t pixels = pixel_count(task.window);
  film.sampled.resize(pixels);
  if (layers.narrow) film.narrow.resize(pixels);
  if (!layers.cached) return film;
  if (film.first_cached_sample != task.first_cached_sample) {
    film.cached.clear();
    film.cached_samples = {};
  }
  film.cached.resize(pixels);
  film.first_cached_sample = task.first_cached_sample;
  return film;
}

std::string bytes_of(const TileFilm& film) {
  std::string bytes;
  append_bytes(bytes, film.passes);
  append_bytes(bytes, film.samples);
  append_bytes(bytes, film.first_cached_sample);
  append_bytes(bytes, film.cached_samples.even);
  append_bytes(bytes, film.cached_samples.odd);
  append_layer(bytes, film.sampled);
  append_layer(bytes, film.cached);
  append_layer(bytes, film.narrow);
  return bytes;
}

TileFilm film_after(const TileTask& task, FilmLayers layers, std::string_view bytes) {
  ByteReader reader(bytes);
  TileFilm film = take_film(reader);
  cache::expect_end(reader);
  const size_t pixels = pixel_count(task.window);
  if (film.passes != task.pass + 1 || film.samples != task.first_sample + task.sample_count ||
      (layers.cached && film.first_cached_sample != task.first_cached_sample))
    refuse_poisoned("its samples are not the task's");
  if (film.sampled.size() != pixels || film.cached.size() != (layers.cached ? pixels : 0) ||
      film.narrow.size() != (layers.narrow ? pixels : 0))
    refuse_poisoned("it has not the size of its tile");
  return film;
}

std::string bytes_of(const TaskInput& input) {
  std::string bytes;
  append_bytes(bytes, input.step);
  append_bytes(bytes, static_cast<uint8_t>(input.what.index()));
  std::visit([&](const auto& what) { append(bytes, what); }, input.what);
  return bytes;
}

TaskInput task_input(std::string_view bytes) {
  try {
    ByteReader reader(bytes);
    TaskInput input;
    input.step = reader.take<uint32_t>();
    switch (reader.take<uint8_t>()) {
      case 0:
        input.what = PreparationInput{.task = reader.take<uint32_t>()};
        break;
      case 1:
        input.what = take_survey(reader);
        break;
      case 2:
        input.what = take_tile(reader);
        break;
      default:
        refuse_poisoned("there is no such kind of task");
    }
    cache::expect_end(reader);
    return input;
  } catch (const Error& error) {
    throw Error(ErrorKind::invalid_argument, "INVALID_TASK", error.what());
  }
}

}  // namespace fogbank::render
