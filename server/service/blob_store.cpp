#include "service/blob_store.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>

#include "core/failpoint.h"
#include "service/limits.h"
#include "service/names.h"
#include "service/rpc_error.h"

namespace fogbank::service {

namespace fs = std::filesystem;
using grpc::StatusCode;

namespace {

/// Size of a regular file, or nullopt when there is none.
std::optional<int64_t> size_of(const fs::path& path) {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return std::nullopt;
  return status.st_size;
}

std::chrono::seconds age_of(const fs::path& path) {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0) return std::chrono::seconds(0);
  return std::chrono::seconds(std::max<int64_t>(0, ::time(nullptr) - status.st_mtime));
}

}  // namespace

BlobStore::BlobStore(fs::path root, TenantQuota* quota) : root_(std::move(root)), quota_(quota) {
  create_folder_durably(root_ / "partial");
}

fs::path BlobStore::blob_path(const std::string& sha256) const {
  return root_ / sha256.substr(0, 2) / sha256;
}
fs::path BlobStore::partial_path(const std::string& sha256) const { return root_ / "partial" / sha256; }

BlobStore::Presence BlobStore::query(const std::string& sha256) {
  check_sha256(sha256);
  const std::lock_guard lock(mutex_);
  const fs::path whole = blob_path(sha256);
  if (const auto size = size_of(whole)) {
    ::utimensat(AT_FDCWD, whole.c_str(), nullptr, AT_SYMLINK_NOFOLLOW);
    return {.committed_size = *size, .complete = true};
  }
  return {.committed_size = size_of(partial_path(sha256)).value_or(0), .complete = false};
}

std::optional<BlobStore::Blob> BlobStore::find(const std::string& sha256) const {
  const fs::path whole = blob_path(sha256);
  const auto size = size_of(whole);
  if (!size) return std::nullopt;
  return Blob{.path = whole, .size = *size};
}

std::optional<BlobStore::Blob> BlobStore::find_intact(const std::string& sha256) {
  std::optional<Blob> blob = find(sha256);
  if (!blob) return std::nullopt;
  const FileDescriptor file = open_file(blob->path, O_RDONLY);
  Sha256 hash;
  std::string buffer(size_t{1} << 20, '\0');
  while (true) {
    const ssize_t count = ::read(file.get(), buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) throw_file_error(errno, "reading", blob->path);
    if (count == 0) break;
    hash.update(buffer.data(), static_cast<size_t>(count));
  }
  if (hash.finish() == sha256) return blob;
  const std::lock_guard lock(mutex_);
  ::unlink(blob->path.c_str());
  throw RpcError(StatusCode::DATA_LOSS, "BLOB_DAMAGED",
                 "a stored file is not what was uploaded any more; upload it again", {{"sha256", sha256}});
}

BlobStore::Upload::Upload(BlobStore& store, std::string sha256, int64_t size)
    : store_(store), sha256_(std::move(sha256)), size_(size), partial_(store.partial_path(sha256_)) {}

BlobStore::Upload::~Upload() {
  file_.close();
  const std::lock_guard lock(store_.mutex_);
  store_.uploading_.erase(sha256_);
}

std::unique_ptr<BlobStore::Upload> BlobStore::begin(const std::string& sha256, int64_t size, int64_t offset) {
  check_sha256(sha256);
  if (size < 0 || offset < 0) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_UPLOAD", "size and offset must not be negative");
  }
  if (size > limits::max_blob_bytes) {
    throw RpcError(StatusCode::RESOURCE_EXHAUSTED, "BLOB_TOO_LARGE",
                   "a blob of " + std::to_string(size) + " bytes is above the limit of " +
                       std::to_string(limits::max_blob_bytes) + " bytes",
                   {{"limit", "max_blob_bytes"}});
  }
  std::unique_ptr<Upload> upload;
  {
    const std::lock_guard lock(mutex_);
    if (!uploading_.insert(sha256).second) {
      throw RpcError(StatusCode::ABORTED, "UPLOAD_IN_PROGRESS", "another stream is uploading this blob",
                     {{"sha256", sha256}});
    }
    upload.reset(new Upload(*this, sha256, size));
  }
  if (const auto blob = find(sha256)) {
    if (blob->size != size) {
      throw RpcError(
          StatusCode::INVALID_ARGUMENT, "BLOB_SIZE_MISMATCH",
          "the blob of this hash has " + std::to_string(blob->size) + " bytes, not " + std::to_string(size));
    }
    upload->already_complete_ = true;
    return upload;
  }
  const int64_t committed = size_of(upload->partial_).value_or(0);
  if (offset != 0 && offset != committed) {
    throw RpcError(StatusCode::OUT_OF_RANGE, "UPLOAD_OFFSET_MISMATCH",
                   "offset " + std::to_string(offset) + " is not the committed size of " +
                       std::to_string(committed) + " bytes",
                   {{"committed_size", std::to_string(committed)}});
  }
  if (quota_ != nullptr) upload->reservation_ = quota_->reserve_stored(size - (offset == 0 ? 0 : committed));
  FOGBANK_FAILPOINT("blob.before_open");
  upload->file_ = open_file(upload->partial_, O_RDWR | O_CREAT | (offset == 0 ? O_TRUNC : O_APPEND));
  std::array<char, 256 << 10> buffer{};
  while (upload->written_ < offset) {
    const ssize_t count = ::read(upload->file_.get(), buffer.data(), buffer.size());
    if (count <= 0) throw_file_error(count < 0 ? errno : EIO, "reading", upload->partial_);
    upload->hash_.update(buffer.data(), static_cast<size_t>(count));
    upload->written_ += count;
  }
  return upload;
}

void BlobStore::Upload::append(std::string_view chunk) {
  if (chunk.empty()) throw RpcError(StatusCode::INVALID_ARGUMENT, "INVALID_UPLOAD", "a chunk is empty");
  if (chunk.size() > static_cast<size_t>(limits::max_upload_chunk_bytes)) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "CHUNK_TOO_LARGE",
                   "a chunk of " + std::to_string(chunk.size()) + " bytes is above the limit of " +
                       std::to_string(limits::max_upload_chunk_bytes) + " bytes",
                   {{"limit", "max_upload_chunk_bytes"}});
  }
  if (static_cast<int64_t>(chunk.size()) > size_ - written_) {
    throw RpcError(StatusCode::INVALID_ARGUMENT, "BLOB_SIZE_MISMATCH",
                   "more than the declared " + std::to_string(size_) + " bytes were sent");
  }
  FOGBANK_FAILPOINT("blob.before_chunk");
  write_all(file_, chunk, partial_);
  FOGBANK_FAILPOINT("blob.after_chunk");
  reservation_.written(static_cast<int64_t>(chunk.size()));
  hash_.update(chunk);
  written_ += static_cast<int64_t>(chunk.size());
}

void BlobStore::Upload::finish() {
  if (already_complete_) return;
  if (written_ != size_) {
    throw RpcError(
        StatusCode::INVALID_ARGUMENT, "BLOB_SIZE_MISMATCH",
        "the upload ended after " + std::to_string(written_) + " of " + std::to_string(size_) + " bytes",
        {{"committed_size", std::to_string(written_)}});
  }
  const std::string actual = hash_.finish();
  if (actual != sha256_) {
    file_.close();
    ::unlink(partial_.c_str());
    throw RpcError(StatusCode::INVALID_ARGUMENT, "BLOB_HASH_MISMATCH",
                   "the bytes have SHA-256 " + actual + ", not " + sha256_);
  }
  FOGBANK_FAILPOINT("blob.before_sync");
  sync_file(file_, partial_);
  file_.close();
  const fs::path whole = store_.blob_path(sha256_);
  create_folder_durably(whole.parent_path());
  FOGBANK_FAILPOINT("blob.before_publish");
  rename_durably(partial_, whole);
  FOGBANK_FAILPOINT("blob.after_publish");
}

void BlobStore::sweep(const std::set<std::string>& in_use, std::chrono::seconds blob_lifetime,
                      std::chrono::seconds partial_lifetime) {
  std::error_code ignored;  // a file that vanishes meanwhile is what this is about
  for (const auto& folder : fs::directory_iterator(root_, ignored)) {
    const bool partial = folder.path().filename() == "partial";
    for (const auto& entry : fs::directory_iterator(folder.path(), ignored)) {
      const std::string name = entry.path().filename().string();
      const std::lock_guard lock(mutex_);
      if (uploading_.contains(name) || (!partial && in_use.contains(name))) continue;
      if (age_of(entry.path()) >= (partial ? partial_lifetime : blob_lifetime))
        fs::remove(entry.path(), ignored);
    }
  }
}

}  // namespace fogbank::service
