#include "service/cache_transfer.h"

#include <atomic>
#include <string>
#include <vector>

#include "cache/store/store.h"
#include "core/error.h"
#include "core/sha256.h"
#include "service/file_stream.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/temporary_file.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

std::string hash_file(const fs::path& path, int64_t size) {
  constexpr int64_t piece = 1 << 20;
  Sha256 hash;
  for (int64_t offset = 0; offset < size; offset += piece) hash.update(read_range(path, offset, piece));
  return hash.finish();
}

/// A file that `write` makes, to be streamed and then removed.
StreamedFile make_file(const CacheRegistry& caches, const std::function<void(const fs::path&)>& write) {
  static std::atomic<uint64_t> counter = 0;
  StreamedFile file;
  file.path = caches.transfer_folder() / std::to_string(++counter);
  file.temporary = TemporaryFile(file.path);
  write(file.path);
  file.size = static_cast<int64_t>(fs::file_size(file.path));
  file.sha256 = hash_file(file.path, file.size);
  file.damage = "STORAGE_ERROR";
  return file;
}

template <typename Response>
void set_chunk(Response& response, const StreamedFile& file, int64_t offset, std::string bytes) {
  v1::FileChunk& chunk = *response.mutable_chunk();
  chunk.set_size(file.size);
  chunk.set_sha256(file.sha256);
  chunk.set_offset(offset);
  chunk.set_data(std::move(bytes));
}

}  // namespace

void with_file_errors(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    if (error.reason() == "CACHE_MISMATCH")
      throw RpcError(StatusCode::FAILED_PRECONDITION, "CACHE_OF_ANOTHER_SCENE", error.what());
    if (error.kind() == ErrorKind::data_loss || error.kind() == ErrorKind::failed_precondition)
      throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_CACHE_FILE", error.what());
    throw;
  }
}

fs::path uploaded_file(const std::string& sha256, BlobStore& blobs) {
  check_sha256(sha256);
  blobs.query(sha256);  // counts as a use
  const auto blob = blobs.find_intact(sha256);
  if (!blob) {
    throw RpcError(StatusCode::FAILED_PRECONDITION, "BLOBS_MISSING", "the cache file is not uploaded",
                   {{"sha256", sha256}});
  }
  return blob->path;
}

grpc::ServerWriteReactor<v1::ExportCacheResponse>* start_export(const v1::ExportCacheRequest& request,
                                                                CacheRegistry& caches, TaskQueue& queue) {
  const auto open = [name = request.name(), &caches] {
    return make_file(caches, [&](const fs::path& path) { caches.export_to(parse_cache_name(name), path); });
  };
  return new FileStream<v1::ExportCacheResponse>(queue, request.offset(), open, set_chunk);
}

grpc::ServerWriteReactor<v1::MergeCachesResponse>* start_merge(const v1::MergeCachesRequest& request,
                                                               CacheRegistry& caches, BlobStore& blobs,
                                                               TaskQueue& queue) {
  const auto open = [request, &caches, &blobs] {
    if (request.sha256s_size() < 2 || request.sha256s_size() > limits::max_merge_files) {
      throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_MERGE",
                     std::to_string(request.sha256s_size()) + " files; a merge takes 2 to " +
                         std::to_string(limits::max_merge_files),
                     {{"limit", "max_merge_files"}});
    }
    std::vector<fs::path> inputs;
    for (const std::string& sha256 : request.sha256s()) inputs.push_back(uploaded_file(sha256, blobs));
    with_file_errors([&] { caches.require_room_for(inputs); });
    return make_file(
        caches, [&](const fs::path& path) { with_file_errors([&] { cache::merge_exports(inputs, path); }); });
  };
  return new FileStream<v1::MergeCachesResponse>(queue, request.offset(), open, set_chunk);
}

}  // namespace fogbank::service
