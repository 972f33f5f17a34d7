#include "render/tile_samples.h"

#include "core/random.h"
#include "integrators/integrator.h"

namespace fogbank::render {

uint64_t add_samples(const TileTask& task, const integrators::Integrator& integrator,
                     const FilmCamera& camera, uint64_t seed, RayCounters& counters, TileFilm& film) {
  // Each poll reads the clock, which takes about as long as 1 % of a sample.
  constexpr uint32_t samples_between_polls = 16;
  uint32_t until_poll = 0;
  uint64_t invalid_samples = 0;
  const bool layered = !film.cached.empty();
  const bool blurred = !film.narrow.empty();
  const uint32_t end_sample = task.first_sample + task.sample_count;
  const uint32_t end_cached = task.first_sample + task.cached_sample_count;
  size_t pixel = 0;
  for (int32_t y = task.window.y; y < task.window.y + task.window.height; ++y) {
    for (int32_t x = task.window.x; x < task.window.x + task.window.width; ++x, ++pixel) {
      for (uint32_t index = task.first_sample; index < end_sample; ++index) {
        if (until_poll-- == 0) {
          counters.poll();
          until_poll = samples_between_polls - 1;
        }
        RandomStream random(seed, static_cast<uint32_t>(x), static_cast<uint32_t>(y), index);
        const Ray ray = camera.sample(static_cast<uint32_t>(x), static_cast<uint32_t>(y), random);
        const integrators::PixelSample sample = layered && index >= end_cached
                                                    ? integrator.sample_without_cache(ray, random, counters)
                                                    : integrator.sample(ray, random, counters);
        const Spectrum sum = sample.sampled + sample.cached;
        // A single NaN would stay in the pixel for ever. Black is wrong as well, hence the count, which isn't
        // hidden.
        if (!is_finite(sum) || min_component(sample.sampled) < 0 || min_component(sample.cached) < 0 ||
            !is_finite(sample.narrow) || min_component(sample.narrow) < 0) {
          ++invalid_samples;
          continue;
        }
        film.sampled[pixel].add(index, layered ? sample.sampled : sum);
        if (layered && index < end_cached) film.cached[pixel].add(index, sample.cached);
        if (blurred) film.narrow[pixel].add(index, sample.narrow);
      }
    }
  }
  film.passes = task.pass + 1;
  film.samples = end_sample;
  if (layered) film.cached_samples += SampleCounts::of_range(task.first_sample, end_cached);
  return invalid_samples;
}

}  // namespace fogbank::render
