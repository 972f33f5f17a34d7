// Files that last. A file appears under its name only when it is whole and on the disk.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace fogbank {

/// An open file descriptor.
class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int descriptor) : descriptor_(descriptor) {}
  ~FileDescriptor() { close(); }
  FileDescriptor(FileDescriptor&& other) noexcept : descriptor_(other.release()) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept;

  int get() const { return descriptor_; }
  bool valid() const { return descriptor_ >= 0; }
  void close();

 private:
  int release();

  int descriptor_ = -1;
};

/// Opens with O_CLOEXEC and, for new files, mode 0600. Throws as `throw_file_error`.
FileDescriptor open_file(const std::filesystem::path& path, int flags);

/// All of `bytes` at the descriptor's position. Throws as `throw_file_error`.
void write_all(const FileDescriptor& file, std::string_view bytes, const std::filesystem::path& path);

/// Contents become durable. Throws as `throw_file_error`.
void sync_file(const FileDescriptor& file, const std::filesystem::path& path);

/// Moves `from` to `to` on the same file system and makes both folders' entries durable.
void rename_durably(const std::filesystem::path& from, const std::filesystem::path& to);

/// A folder's entries become durable. Throws as `throw_file_error`.
void sync_folder(const std::filesystem::path& folder);

/// Makes a folder, and those above it, where they are absent; their names are durable. Throws as
/// `throw_file_error`.
void create_folder_durably(const std::filesystem::path& folder);

/// Writes a temporary file (*.tmp) beside `path`, syncs it, and renames it to `path`.
void write_file_durably(const std::filesystem::path& path, std::string_view bytes);

/// Whole file of at most `max_bytes`.
std::string read_file(const std::filesystem::path& path, int64_t max_bytes);

/// Up to `size` bytes from `offset`; fewer at the end of the file.
std::string read_range(const std::filesystem::path& path, int64_t offset, int64_t size);

/// Throws Error for an errno of a file operation: resource_exhausted DISK_FULL for a full disk or quota, else
/// internal STORAGE_ERROR. The message names what was done and the file's name without its folder.
[[noreturn]] void throw_file_error(int error, const std::string& action, const std::filesystem::path& path);

}  // namespace fogbank
