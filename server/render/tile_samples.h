// The samples of one task of a tile.
#pragma once

#include <cstdint>

#include "core/ray_counters.h"
#include "render/film.h"
#include "render/film_camera.h"
#include "render/task.h"

namespace fogbank::render {

/// Adds them to `film`, which is film_for(task, ...) and has a cached layer where the integrator has; returns
/// how many were not finite or negative, and count as black. Throws Interrupted as `counters` says; the film
/// is useless then. Needs scene::prepare_render_thread.
uint64_t add_samples(const TileTask& task, const integrators::Integrator& integrator,
                     const FilmCamera& camera, uint64_t seed, RayCounters& counters, TileFilm& film);

}  // namespace fogbank::render
