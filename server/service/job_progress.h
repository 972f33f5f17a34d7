// How far a job is and how good its image, in wire form.
#pragma once

#include "fogbank/v1/render.pb.h"
#include "render/progress.h"
#include "render/render_settings.h"

namespace fogbank::service {

v1::ErrorReport to_message(const render::HistoryEntry& entry);

/// Everything but the number of tiles in all and the present rate of rays. `history` is the job's.
v1::Progress to_message(const render::Progress& progress, const std::vector<render::HistoryEntry>& history,
                        const render::RenderSettings& settings);

}  // namespace fogbank::service
