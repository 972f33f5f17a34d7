#include "scene/file_source.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "core/error.h"
#include "scene/loader.h"
#include "scene/text.h"
#include "scene/utf8.h"

namespace fogbank::scene {
namespace {

constexpr size_t longest_path = 1024;

[[noreturn]] void not_found(const std::string& path) {
  throw Error(ErrorKind::not_found, "FILE_NOT_FOUND", "file " + quote(path) + " does not exist");
}

/// Real path of an open descriptor.
std::string opened_path(int descriptor) {
  char buffer[PATH_MAX];
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  const ssize_t size = ::readlink(link.c_str(), buffer, sizeof buffer);
  return size > 0 ? std::string(buffer, static_cast<size_t>(size)) : "";
}

/// Opens `absolute` for reading; `path` is its name in messages. The file is first opened without access
/// (O_PATH), so that neither a FIFO can block nor a device be touched, and what was opened is what is
/// checked: a symbolic link that is exchanged meanwhile changes nothing. An empty `root` allows any place.
FileDescriptor open_regular_file(const std::string& absolute, const std::string& root,
                                 const std::string& path) {
  const FileDescriptor located(::open(absolute.c_str(), O_PATH | O_CLOEXEC));
  if (!located.valid()) {
    if (errno == ENOENT || errno == ENOTDIR) not_found(path);
    throw Error(ErrorKind::not_found, "FILE_UNREADABLE",
                "file " + quote(path) + " can't be opened: " + std::strerror(errno));
  }
  if (!root.empty()) {
    const std::string real = opened_path(located.get());
    if (real.compare(0, root.size(), root) != 0)
      throw Error(ErrorKind::invalid_argument, "PATH_OUTSIDE_ROOT",
                  "file " + quote(path) + " leads out of the scene's root folder through a symbolic link");
  }
  struct stat status {};
  if (::fstat(located.get(), &status) != 0 || !S_ISREG(status.st_mode))
    throw Error(ErrorKind::invalid_argument, "NOT_A_REGULAR_FILE",
                "file " + quote(path) + " is not a regular file");
  if (static_cast<uint64_t>(status.st_size) > LoadLimits::file_bytes)
    throw Error(ErrorKind::resource_exhausted, "FILE_TOO_LARGE",
                "file " + quote(path) + " has " + std::to_string(status.st_size) + " bytes; at most " +
                    std::to_string(LoadLimits::file_bytes) + " are read");
  FileDescriptor opened(
      ::open(("/proc/self/fd/" + std::to_string(located.get())).c_str(), O_RDONLY | O_CLOEXEC));
  if (!opened.valid())
    throw Error(ErrorKind::not_found, "FILE_UNREADABLE",
                "file " + quote(path) + " can't be opened: " + std::strerror(errno));
  return opened;
}

/// A path that a caller hands in must be one that `resolve_path` could have made.
void check_logical(const std::string& path) {
  if (path.empty() || resolve_path("", path) != path)
    throw Error(ErrorKind::invalid_argument, "PATH_OUTSIDE_ROOT",
                "path " + quote(path) + " is not normalised");
}

class FolderSource final : public StoredFiles {
 public:
  explicit FolderSource(const std::string& root) {
    char* real = ::realpath(root.c_str(), nullptr);
    if (!real)
      throw Error(ErrorKind::not_found, "ROOT_NOT_FOUND",
                  "the scene's root folder " + quote(root) + " does not exist");
    root_ = real;
    std::free(real);
    struct stat status {};
    if (::stat(root_.c_str(), &status) != 0 || !S_ISDIR(status.st_mode))
      throw Error(ErrorKind::invalid_argument, "ROOT_NOT_FOUND",
                  "the scene's root " + quote(root) + " is not a folder");
    if (root_.back() != '/') root_ += '/';
  }

  bool exists(const std::string& path) const override {
    check_logical(path);
    return FileDescriptor(::open((root_ + path).c_str(), O_PATH | O_CLOEXEC)).valid();
  }

  FileDescriptor open(const std::string& path) const override {
    check_logical(path);
    return open_regular_file(root_ + path, root_, path);
  }

 private:
  std::string root_;  ///< real path with a trailing slash
};

class BlobSource final : public StoredFiles {
 public:
  explicit BlobSource(std::map<std::string, std::string> blobs) : blobs_(std::move(blobs)) {
    for (const auto& entry : blobs_) check_logical(entry.first);
  }

  bool exists(const std::string& path) const override { return blobs_.count(path) > 0; }

  FileDescriptor open(const std::string& path) const override {
    const auto found = blobs_.find(path);
    if (found == blobs_.end()) not_found(path);
    return open_regular_file(found->second, "", path);
  }

 private:
  std::map<std::string, std::string> blobs_;
};

[[noreturn]] void refuse(const std::string& reference, const std::string& why) {
  throw Error(ErrorKind::invalid_argument, "PATH_OUTSIDE_ROOT", "path " + quote(reference) + " " + why);
}

/// "file:", "http:" and drive letters such as "C:".
bool has_scheme(const std::string& reference) {
  const size_t colon = reference.find(':');
  if (colon == std::string::npos || colon == 0) return false;
  for (size_t i = 0; i < colon; ++i) {
    const char c = reference[i];
    const bool is_letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    const bool is_other = (c >= '0' && c <= '9') || c == '+' || c == '-' || c == '.';
    if (!is_letter && !(i > 0 && is_other)) return false;
  }
  return true;
}

}  // namespace

std::string StoredFiles::read(const std::string& path) const { return read_opened_file(open(path), path); }

std::string read_opened_file(const FileDescriptor& file, const std::string& path) {
  // Not fstat, which whoever reads within a sandbox may not call.
  const off_t size = ::lseek(file.get(), 0, SEEK_END);
  if (size < 0)
    throw Error(ErrorKind::data_loss, "FILE_UNREADABLE",
                "file " + quote(path) + " can't be read: " + std::strerror(errno));
  std::string bytes(static_cast<size_t>(size), '\0');
  size_t done = 0;
  while (done < bytes.size()) {
    const ssize_t count =
        ::pread(file.get(), bytes.data() + done, bytes.size() - done, static_cast<off_t>(done));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0)
      throw Error(ErrorKind::data_loss, "FILE_UNREADABLE",
                  "file " + quote(path) + " ended after " + std::to_string(done) + " of " +
                      std::to_string(bytes.size()) + " bytes");
    done += static_cast<size_t>(count);
  }
  return bytes;
}

std::shared_ptr<StoredFiles> folder_source(const std::string& root) {
  return std::make_shared<FolderSource>(root);
}

std::shared_ptr<StoredFiles> blob_source(std::map<std::string, std::string> blobs) {
  return std::make_shared<BlobSource>(std::move(blobs));
}

std::string resolve_path(const std::string& from, const std::string& reference) {
  if (reference.size() > longest_path) refuse(reference, "is longer than 1024 bytes");
  if (reference.empty()) refuse(reference, "is empty");
  for (const char c : reference)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) refuse(reference, "has control characters");
  if (!is_valid_utf8(reference)) refuse(reference, "is not UTF-8");
  if (has_scheme(reference))
    refuse(reference, "has a scheme or drive; paths are relative to the scene's folder");

  std::string slashed = reference;
  for (char& c : slashed)
    if (c == '\\') c = '/';
  if (slashed[0] == '/') refuse(reference, "is absolute; paths are relative to the scene's folder");

  const size_t folder_end = from.rfind('/');
  std::vector<std::string> parts;
  const auto append = [&](const std::string& text) {
    size_t begin = 0;
    while (begin <= text.size()) {
      const size_t end = std::min(text.find('/', begin), text.size());
      const std::string part = text.substr(begin, end - begin);
      begin = end + 1;
      if (part.empty() || part == ".") continue;
      if (part != "..") {
        parts.push_back(part);
      } else if (parts.empty()) {
        refuse(reference, "leads out of the scene's root folder");
      } else {
        parts.pop_back();
      }
    }
  };
  if (folder_end != std::string::npos) append(from.substr(0, folder_end));
  append(slashed);

  std::string path;
  for (const std::string& part : parts) {
    if (!path.empty()) path += '/';
    path += part;
  }
  if (path.size() > longest_path) refuse(reference, "is longer than 1024 bytes");
  return path;
}

}  // namespace fogbank::scene
