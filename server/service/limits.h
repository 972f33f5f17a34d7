// Every limit of the service, with its unit in the name or the type. GetCapabilities shows them all, from
// `table`.
#pragma once

#include <cstdint>
#include <span>

#include "cache/flatland/fill.h"
#include "derivatives/estimator.h"
#include "derivatives/flatland/model.h"
#include "render/render_job.h"

namespace fogbank::service::limits {

// Messages and uploads, bytes unless they say otherwise.
inline constexpr int64_t max_request_bytes = 4 << 20;
inline constexpr int64_t max_upload_chunk_bytes = 256 << 10;
inline constexpr int64_t max_download_chunk_bytes = 256 << 10;
inline constexpr int64_t max_tile_message_bytes = 256 << 10;
inline constexpr int64_t max_blob_bytes = int64_t{2} << 30;
inline constexpr int64_t max_scene_bytes = int64_t{16} << 30;
inline constexpr int64_t max_manifest_files = 16384;
inline constexpr int64_t max_path_bytes = 1024;
inline constexpr int64_t max_parameters = 256;
inline constexpr double blob_lifetime_seconds = 24 * 3600;
inline constexpr double partial_upload_lifetime_seconds = 600;

// Scenes.
inline constexpr int64_t max_queued_scene_loads = 64;
inline constexpr int64_t max_scenes = 1000;

// Jobs.
inline constexpr int64_t max_queued_jobs = 1000;
inline constexpr int64_t max_kept_jobs = 10000;
inline constexpr int64_t max_image_side = render::RenderLimits::film_side;
inline constexpr int64_t max_image_pixels = render::RenderLimits::crop_pixels;
inline constexpr int64_t max_samples_per_pixel = render::RenderLimits::samples_per_pixel;
inline constexpr int64_t max_path_depth = render::RenderLimits::path_depth;
inline constexpr double max_time_budget_seconds = render::RenderLimits::time_budget_seconds;
inline constexpr int64_t min_tile_size = render::RenderLimits::smallest_tile;
inline constexpr int64_t max_tile_size = render::RenderLimits::largest_tile;
inline constexpr int64_t default_tile_size = 32;
inline constexpr double cancel_seconds = 0.2;
/// A tile, or another task of a job, that runs longer is reported; one that runs longer still ends its job.
inline constexpr double default_task_report_seconds = 30;
inline constexpr double default_task_limit_seconds = 900;
/// So long a job that was ended waits for a task that doesn't heed it.
inline constexpr double stuck_task_seconds = 10;
/// Share of a job's render CPU time that writing its checkpoints may take.
inline constexpr double checkpoint_share = 0.01;

// Probes.
inline constexpr int64_t max_probes = 64;
/// Results of one message stay below max_tile_message_bytes: at most 72 numbers a point, 160 KiB in all.
inline constexpr int64_t max_probe_chunk_points = 256;
/// Enough for every thread to work on while results are under way; about 1 MB a stream.
inline constexpr int64_t max_probe_points_in_flight = 4 * max_probe_chunk_points;
inline constexpr int64_t min_probe_samples = derivatives::EstimatorLimits::fewest_samples;
inline constexpr int64_t max_probe_samples = derivatives::EstimatorLimits::most_samples;
inline constexpr int64_t max_probe_repeats = derivatives::EstimatorLimits::most_repeats;
/// So long a task of a probe keeps its thread before another workload may have it, one point at least.
inline constexpr double probe_slice_seconds = 0.02;
inline constexpr double probe_stall_seconds = 600;

// Caches.
inline constexpr int64_t max_fills = 16;
inline constexpr int64_t max_fill_cameras = 10000;
inline constexpr int64_t max_merge_files = 64;
inline constexpr int64_t max_view_side = 4096;
inline constexpr int64_t default_view_side = 1024;
inline constexpr int64_t max_kept_epochs = 4;

// Farms. An answer holds some tasks beside the largest, a tile of 128 x 128 pixels with two layers.
inline constexpr int64_t max_leased_tasks = 1024;
inline constexpr int64_t max_lease_bytes = 3584 << 10;
inline constexpr double max_lease_wait_seconds = 60;
inline constexpr double max_trip_seconds = 10;
inline constexpr int64_t max_result_part_bytes = 1 << 20;
inline constexpr int64_t max_result_bytes = 64 << 20;
inline constexpr int64_t max_log_entry_bytes = render::JobLog::most_entry_bytes;
inline constexpr int64_t max_log_bytes = render::JobLog::most_bytes;
inline constexpr int64_t max_replicas = 16;
inline constexpr double replica_lifetime_seconds = 900;

// Points of the two-dimensional model.
inline constexpr int64_t max_flatland_points = 4096;
inline constexpr int64_t max_flatland_cache_points = 256 * 256;
inline constexpr int64_t max_flatland_records = cache::flatland::largest_record_count;
inline constexpr int64_t max_flatland_segments = derivatives::flatland::largest_segment_count;
inline constexpr int64_t min_flatland_samples = derivatives::flatland::smallest_sample_count;
inline constexpr int64_t max_flatland_samples = derivatives::flatland::largest_sample_count;
inline constexpr int64_t max_flatland_bisections = derivatives::flatland::largest_bisection_count;
inline constexpr int64_t max_flatland_march_points = derivatives::flatland::largest_march_points;

// Lists.
inline constexpr int64_t max_page_size = 200;
inline constexpr int64_t default_page_size = 50;

// Streams.
inline constexpr int64_t max_watchers = 2000;
inline constexpr double min_update_interval_seconds = 0.05;
inline constexpr double default_update_interval_seconds = 1;
inline constexpr double max_update_interval_seconds = 3600;
inline constexpr double progress_interval_seconds = 0.5;
inline constexpr double heartbeat_seconds = 10;
inline constexpr double watch_stall_seconds = 60;
/// Share of a job's render CPU time that encoding its intermediate tiles may cost.
inline constexpr double streaming_share = 0.02;

// Shutdown: for watchers to read their terminal events, and then for the streams to end.
inline constexpr double drain_seconds = 5;
inline constexpr double shutdown_seconds = 2;

// Upkeep, such as of the bytes that count for quotas.
inline constexpr double sweep_seconds = 60;
/// When to ask again for what others of the same tenant have to let go first.
inline constexpr double quota_retry_seconds = 5;

// The server connects to itself so often, waits so long, and gives up after so many failures in a row.
inline constexpr double self_probe_seconds = 5;
inline constexpr double self_probe_timeout_seconds = 5;
inline constexpr int self_probe_tries = 3;

// Certificates and keys are read again so often.
inline constexpr double certificate_reload_seconds = 5;

struct Entry {
  const char* name;
  double value;
  const char* unit;
  const char* description;
};

/// All limits that clients can meet.
std::span<const Entry> table();

}  // namespace fogbank::service::limits
