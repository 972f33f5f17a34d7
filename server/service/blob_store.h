// Uploaded files by content. A blob that reads back is what its name says: it appears under its SHA-256 only
// after the hash was checked and the file synced.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <string_view>

#include "core/files.h"
#include "core/sha256.h"
#include "service/tenant_quota.h"

namespace fogbank::service {

/// `root`/{first two digits}/{sha256} holds whole blobs, `root`/partial/{sha256} unfinished ones.
/// Thread-safe.
class BlobStore {
 public:
  /// `quota` null: there is none.
  explicit BlobStore(std::filesystem::path root, TenantQuota* quota = nullptr);

  struct Presence {
    int64_t committed_size = 0;
    bool complete = false;
  };
  /// Also counts as a use: the blob's lifetime starts again.
  Presence query(const std::string& sha256);

  /// Path and size of a whole blob.
  struct Blob {
    std::filesystem::path path;
    int64_t size = 0;
  };
  std::optional<Blob> find(const std::string& sha256) const;
  /// As `find`, for use: all of it is read. One that is not what its name says any more is removed, so that
  /// it can be uploaded again. Throws RpcError BLOB_DAMAGED.
  std::optional<Blob> find_intact(const std::string& sha256);

  /// One upload in progress. Destroyed unfinished, it leaves what it has as a partial upload.
  class Upload {
   public:
    ~Upload();
    /// Throws RpcError CHUNK_TOO_LARGE, INVALID_UPLOAD (empty), BLOB_SIZE_MISMATCH (more than declared),
    /// DISK_FULL.
    void append(std::string_view chunk);
    /// Throws RpcError BLOB_SIZE_MISMATCH (fewer bytes than declared), BLOB_HASH_MISMATCH (the bytes are
    /// discarded).
    void finish();
    int64_t size() const { return size_; }
    /// The blob was there before; chunks are of no interest.
    bool already_complete() const { return already_complete_; }

   private:
    friend class BlobStore;
    Upload(BlobStore& store, std::string sha256, int64_t size);

    BlobStore& store_;
    std::string sha256_;
    int64_t size_;
    int64_t written_ = 0;
    bool already_complete_ = false;
    std::filesystem::path partial_;
    FileDescriptor file_;
    Sha256 hash_;
    DiskMeter::Reservation reservation_;
  };

  /// Begins or continues an upload. Reads what was committed before, to go on hashing. Throws RpcError
  /// INVALID_SHA256, INVALID_UPLOAD (negative size or offset), BLOB_TOO_LARGE, UPLOAD_OFFSET_MISMATCH,
  /// UPLOAD_IN_PROGRESS, QUOTA_EXCEEDED.
  std::unique_ptr<Upload> begin(const std::string& sha256, int64_t size, int64_t offset);

  /// Removes whole blobs that are not in `in_use` and were last used `blob_lifetime` ago, and partial uploads
  /// that had no chunk for `partial_lifetime`.
  void sweep(const std::set<std::string>& in_use, std::chrono::seconds blob_lifetime,
             std::chrono::seconds partial_lifetime);

 private:
  std::filesystem::path blob_path(const std::string& sha256) const;
  std::filesystem::path partial_path(const std::string& sha256) const;

  std::filesystem::path root_;
  TenantQuota* quota_;
  mutable std::mutex mutex_;
  std::set<std::string> uploading_;
};

}  // namespace fogbank::service
