#include "service/job_progress.h"

#include <algorithm>
#include <cmath>

namespace fogbank::service {

namespace {

/// Share of the work that is done: of whichever of samples, time and error ends the job first.
double done(const render::Progress& progress, const render::RenderSettings& settings) {
  double fraction = 0;
  if (progress.samples_planned > 0) {
    fraction = static_cast<double>(progress.samples_done) / static_cast<double>(progress.samples_planned);
  }
  if (settings.time_budget_seconds > 0)
    fraction = std::max(fraction, progress.render_seconds / settings.time_budget_seconds);
  // Noise falls with the root of the work.
  if (settings.error > 0 && progress.estimate.error)
    fraction = std::max(fraction, std::pow(settings.error / *progress.estimate.error, 2));
  return std::clamp(fraction, 0.0, 1.0);
}

}  // namespace

v1::ErrorReport to_message(const render::HistoryEntry& entry) {
  v1::ErrorReport message;
  message.set_elapsed_seconds(entry.wall_seconds);
  message.set_cpu_seconds(entry.cpu_seconds);
  message.set_samples_per_pixel(static_cast<int32_t>(entry.samples));
  message.set_records(entry.records);
  message.set_epoch(entry.epoch);
  const render::ErrorEstimate& estimate = entry.estimate;
  if (estimate.error) message.set_estimated_error(*estimate.error);
  if (estimate.noise) message.set_noise(*estimate.noise);
  message.set_bias(estimate.bias);
  if (estimate.true_error) {
    message.mutable_true_error()->set_relative_mse(estimate.true_error->relative_mse);
    message.mutable_true_error()->set_median(estimate.true_error->median);
    message.mutable_true_error()->set_percentile_99(estimate.true_error->percentile_99);
  }
  return message;
}

v1::Progress to_message(const render::Progress& progress, const std::vector<render::HistoryEntry>& history,
                        const render::RenderSettings& settings) {
  v1::Progress message;
  message.set_passes_done(static_cast<int32_t>(progress.passes_done));
  message.set_passes_total(static_cast<int32_t>(progress.pass_count));
  message.set_samples_per_pixel_done(static_cast<int32_t>(progress.samples_per_pixel));
  message.set_tiles_done(static_cast<int32_t>(progress.tiles_done));
  const double fraction = done(progress, settings);
  message.set_fraction(fraction);
  message.set_rays(progress.rays);
  message.set_elapsed_seconds(progress.render_seconds);
  if (fraction > 0) message.set_eta_seconds(progress.render_seconds * (1 - fraction) / fraction);
  message.set_phase(progress.preparing ? v1::JOB_PHASE_FILLING : v1::JOB_PHASE_RENDERING);
  message.set_records_reused(progress.records_reused);
  message.set_records_new(progress.records_new);
  message.set_epoch(progress.epoch);
  if (!history.empty()) *message.mutable_report() = to_message(history.back());
  return message;
}

}  // namespace fogbank::service
