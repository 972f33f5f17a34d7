#include "service/limits.h"

namespace fogbank::service::limits {

std::span<const Entry> table() {
  static constexpr Entry entries[] = {
      {"max_request_bytes", max_request_bytes, "bytes", "size of one request message"},
      {"max_upload_chunk_bytes", max_upload_chunk_bytes, "bytes", "chunk of UploadBlob"},
      {"max_download_chunk_bytes", max_download_chunk_bytes, "bytes", "chunk of DownloadImage"},
      {"max_tile_message_bytes", max_tile_message_bytes, "bytes", "encoded tile of WatchJob"},
      {"max_blob_bytes", max_blob_bytes, "bytes", "one uploaded file"},
      {"max_scene_bytes", max_scene_bytes, "bytes", "all files of a scene"},
      {"max_manifest_files", max_manifest_files, "count", "files of a scene"},
      {"max_path_bytes", max_path_bytes, "bytes", "logical path in a manifest"},
      {"max_parameters", max_parameters, "count", "load parameters of a scene"},
      {"blob_lifetime_seconds", blob_lifetime_seconds, "seconds",
       "how long a blob that no scene needs is kept"},
      {"partial_upload_lifetime_seconds", partial_upload_lifetime_seconds, "seconds",
       "how long an unfinished upload is kept after its last chunk"},
      {"max_queued_scene_loads", max_queued_scene_loads, "count", "scenes waiting to be loaded"},
      {"max_scenes", max_scenes, "count", "scenes known"},
      {"max_queued_jobs", max_queued_jobs, "count", "jobs that have not ended"},
      {"max_kept_jobs", max_kept_jobs, "count", "jobs that have ended; the oldest go first"},
      {"max_image_side", max_image_side, "pixels", "width or height of the film"},
      {"max_image_pixels", max_image_pixels, "pixels", "pixels of the crop window"},
      {"max_samples_per_pixel", max_samples_per_pixel, "count", "samples per pixel"},
      {"max_path_depth", max_path_depth, "count", "max_depth and rr_depth"},
      {"max_time_budget_seconds", max_time_budget_seconds, "seconds", "time budget of a job"},
      {"min_tile_size", min_tile_size, "pixels", "side of a tile"},
      {"max_tile_size", max_tile_size, "pixels", "side of a tile"},
      {"default_tile_size", default_tile_size, "pixels", "side of a tile when a job names none"},
      {"cancel_seconds", cancel_seconds, "seconds", "threads of a cancelled job are free after at most this"},
      {"max_page_size", max_page_size, "count", "entries of one page of a list"},
      {"default_page_size", default_page_size, "count", "entries of a page when a request names no size"},
      {"max_watchers", max_watchers, "count", "open WatchJob streams"},
      {"min_update_interval_seconds", min_update_interval_seconds, "seconds",
       "least update interval of a tile"},
      {"default_update_interval_seconds", default_update_interval_seconds, "seconds",
       "update interval of a tile when a job names none"},
      {"max_update_interval_seconds", max_update_interval_seconds, "seconds",
       "greatest update interval of a tile"},
      {"progress_interval_seconds", progress_interval_seconds, "seconds", "between two progress events"},
      {"heartbeat_seconds", heartbeat_seconds, "seconds", "a watcher hears something at least so often"},
      {"watch_stall_seconds", watch_stall_seconds, "seconds",
       "a watcher that reads nothing for so long is disconnected"},
      {"streaming_share", streaming_share, "share of render CPU time",
       "what encoding intermediate tiles may cost; above it they wait"},
      {"drain_seconds", drain_seconds, "seconds", "given to watchers for their last event at shutdown"},
  };
  return entries;
}

}  // namespace fogbank::service::limits
