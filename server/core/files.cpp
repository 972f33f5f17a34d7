#include "core/files.h"
#include "core/failpoint.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <utility>

#include "core/error.h"

namespace fogbank {

FileDescriptor& FileDescriptor::operator=(FileDescriptor&& other) noexcept {
  if (this != &other) {
    close();
    descriptor_ = other.release();
  }
  return *this;
}

void FileDescriptor::close() {
  if (descriptor_ >= 0) ::close(descriptor_);
  descriptor_ = -1;
}

int FileDescriptor::release() { return std::exchange(descriptor_, -1); }

FileDescriptor open_file(const std::filesystem::path& path, int flags) {
  FileDescriptor file(::open(path.c_str(), flags | O_CLOEXEC, 0600));
  if (!file.valid()) throw_file_error(errno, "opening", path);
  return file;
}

void write_all(const FileDescriptor& file, std::string_view bytes, const std::filesystem::path& path) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(file.get(), bytes.data(), bytes.size());
    if (written < 0) {
      if (errno == EINTR) continue;
      throw_file_error(errno, "writing", path);
    }
    bytes.remove_prefix(static_cast<size_t>(written));
  }
}

void sync_file(const FileDescriptor& file, const std::filesystem::path& path) {
  if (::fsync(file.get()) != 0) throw_file_error(errno, "syncing", path);
}

void sync_folder(const std::filesystem::path& folder) {
  sync_file(open_file(folder, O_RDONLY | O_DIRECTORY), folder);
}

void rename_durably(const std::filesystem::path& from, const std::filesystem::path& to) {
  FOGBANK_FAILPOINT("file.before_rename");
  if (::rename(from.c_str(), to.c_str()) != 0) throw_file_error(errno, "renaming", from);
  FOGBANK_FAILPOINT("file.after_rename");
  sync_folder(to.parent_path());
  if (from.parent_path() != to.parent_path()) sync_folder(from.parent_path());
}

void create_folder_durably(const std::filesystem::path& folder) {
  if (folder.empty() || std::filesystem::is_directory(folder)) return;
  create_folder_durably(folder.parent_path());
  if (::mkdir(folder.c_str(), 0777) != 0 && errno != EEXIST) throw_file_error(errno, "making", folder);
  sync_folder(folder.has_parent_path() ? folder.parent_path() : ".");
}

void write_file_durably(const std::filesystem::path& path, std::string_view bytes) {
  static std::atomic<uint64_t> counter = 0;
  std::filesystem::path temporary = path;
  temporary += "." + std::to_string(::getpid()) + "." + std::to_string(++counter) + ".tmp";
  try {
    const FileDescriptor file = open_file(temporary, O_WRONLY | O_CREAT | O_TRUNC);
    FOGBANK_FAILPOINT("file.before_write");
    write_all(file, bytes, path);
    FOGBANK_FAILPOINT("file.before_sync");
    sync_file(file, path);
    rename_durably(temporary, path);
  } catch (...) {
    ::unlink(temporary.c_str());
    throw;
  }
}

std::string read_file(const std::filesystem::path& path, int64_t max_bytes) {
  const FileDescriptor file = open_file(path, O_RDONLY);
  struct stat status {};
  if (::fstat(file.get(), &status) != 0) throw_file_error(errno, "reading", path);
  if (status.st_size > max_bytes) throw_file_error(EFBIG, "reading", path);
  return read_range(path, 0, status.st_size);
}

std::string read_range(const std::filesystem::path& path, int64_t offset, int64_t size) {
  const FileDescriptor file = open_file(path, O_RDONLY);
  std::string bytes(static_cast<size_t>(size), '\0');
  size_t filled = 0;
  while (filled < bytes.size()) {
    const ssize_t count = ::pread(file.get(), bytes.data() + filled, bytes.size() - filled,
                                  offset + static_cast<off_t>(filled));
    if (count < 0) {
      if (errno == EINTR) continue;
      throw_file_error(errno, "reading", path);
    }
    if (count == 0) break;
    filled += static_cast<size_t>(count);
  }
  bytes.resize(filled);
  return bytes;
}

void throw_file_error(int error, const std::string& action, const std::filesystem::path& path) {
  const std::string message = action + " " + path.filename().string() + " failed: " + std::strerror(error);
  if (error == ENOSPC || error == EDQUOT) throw Error(ErrorKind::resource_exhausted, "DISK_FULL", message);
  throw Error(ErrorKind::internal, "STORAGE_ERROR", message);
}

}  // namespace fogbank
