// Functions of the C library under their own names: the program's come first wherever they are called, in
// SQLite and the C++ library as well.
#include "syscalls.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdarg>
#include <map>
#include <mutex>
#include <set>

namespace fogbank::faults {
namespace {

struct State {
  std::mutex mutex;
  bool watching = false;
  std::string folder;
  Fault fault = Fault::none;
  int64_t number = 0;
  int64_t count = 0;
  std::map<int, std::string> open_files;   ///< those below the folder
  std::set<std::string> unsynced_entries;  ///< names that a folder got or lost since it was synced
  std::set<std::string> unsynced_files;    ///< files that were written to since they were synced
};

/// Never destroyed: threads may call until the very end.
State& state() {
  static State* const one = new State;
  return *one;
}

template <typename Function>
Function* real(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

enum class Call : uint8_t { open, write, other };

/// 0, or the error that this call is to fail with; -1: a short write. With the lock held.
int fault_of(State& s, Call call) {
  const int64_t number = ++s.count;
  const bool chosen =
      s.number != 0 && (number == s.number || (s.fault == Fault::no_space_anymore && number > s.number));
  if (!chosen) return 0;
  switch (s.fault) {
    case Fault::none:
      return 0;
    case Fault::no_space:
    case Fault::no_space_anymore:
      return ENOSPC;
    case Fault::io_error:
      return EIO;
    case Fault::no_descriptors:
      return call == Call::open ? EMFILE : ENOSPC;
    case Fault::short_write:
      break;
  }
  return call == Call::write ? -1 : EINTR;
}

bool is_below(const State& s, const std::string& path) {
  return s.watching && path.starts_with(s.folder) &&
         (path.size() == s.folder.size() || path[s.folder.size()] == '/');
}

/// Calls `work` unless this call on a path is to fail.
template <typename Work>
int on_path(const char* path, Call call, Work work) {
  State& s = state();
  {
    const std::lock_guard lock(s.mutex);
    if (is_below(s, path)) {
      if (const int error = fault_of(s, call); error != 0) {
        errno = error < 0 ? EINTR : error;
        return -1;
      }
    }
  }
  return work();
}

void note_entry(const char* path) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  if (is_below(s, path)) s.unsynced_entries.insert(path);
}

int open_watched(const char* name, const char* path, int flags, mode_t mode) {
  return on_path(path, Call::open, [&] {
    const bool is_new = (flags & O_CREAT) != 0 && ::access(path, F_OK) != 0;
    const int file = real<int(const char*, int, ...)>(name)(path, flags, mode);
    State& s = state();
    const std::lock_guard lock(s.mutex);
    if (file < 0 || !is_below(s, path)) return file;
    s.open_files[file] = path;
    if (is_new) s.unsynced_entries.insert(path);
    return file;
  });
}

/// Calls `work(bytes)` with what of `size` may be written, unless this call on a descriptor is to fail.
template <typename Work>
ssize_t on_file(int file, Call call, size_t size, Work work) {
  State& s = state();
  {
    const std::lock_guard lock(s.mutex);
    const auto found = s.open_files.find(file);
    if (s.watching && found != s.open_files.end()) {
      const int error = fault_of(s, call);
      if (error > 0) {
        errno = error;
        return -1;
      }
      if (error < 0) size = 1;
      if (call == Call::write) s.unsynced_files.insert(found->second);
    }
  }
  return work(size);
}

int sync_watched(const char* name, int file) {
  return static_cast<int>(on_file(file, Call::other, 0, [&](size_t) -> ssize_t {
    const int result = real<int(int)>(name)(file);
    State& s = state();
    const std::lock_guard lock(s.mutex);
    const auto found = s.open_files.find(file);
    if (result != 0 || found == s.open_files.end()) return result;
    s.unsynced_files.erase(found->second);
    std::erase_if(s.unsynced_entries, [&](const std::string& entry) {
      return std::filesystem::path(entry).parent_path() == found->second;
    });
    return result;
  }));
}

}  // namespace

void watch_calls(const std::filesystem::path& folder, Fault fault, int64_t number) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  s.watching = true;
  s.folder = folder.string();
  s.fault = fault;
  s.number = number;
  s.count = 0;
  s.open_files.clear();
  s.unsynced_entries.clear();
  s.unsynced_files.clear();
}

int64_t stop_watching() {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  s.watching = false;
  return s.count;
}

std::vector<std::string> lost_at_power_cut(const std::filesystem::path& path) {
  State& s = state();
  const std::lock_guard lock(s.mutex);
  std::vector<std::string> lost;
  if (!is_below(s, path.string())) return lost;
  if (s.unsynced_files.contains(path.string())) lost.push_back("bytes of " + path.string());
  for (std::filesystem::path entry = path; entry.string().size() > s.folder.size();
       entry = entry.parent_path())
    if (s.unsynced_entries.contains(entry.string())) lost.push_back("the name " + entry.string());
  return lost;
}

}  // namespace fogbank::faults

using namespace fogbank::faults;

extern "C" {

int open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const auto mode = static_cast<mode_t>(va_arg(arguments, int));
  va_end(arguments);
  return open_watched("open", path, flags, mode);
}

int open64(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const auto mode = static_cast<mode_t>(va_arg(arguments, int));
  va_end(arguments);
  return open_watched("open64", path, flags, mode);
}

int close(int file) {
  {
    State& s = state();
    const std::lock_guard lock(s.mutex);
    s.open_files.erase(file);
  }
  return real<int(int)>("close")(file);
}

ssize_t write(int file, const void* bytes, size_t size) {
  return on_file(file, Call::write, size, [&](size_t most) {
    return real<ssize_t(int, const void*, size_t)>("write")(file, bytes, most);
  });
}

ssize_t pwrite(int file, const void* bytes, size_t size, off_t offset) {
  return on_file(file, Call::write, size, [&](size_t most) {
    return real<ssize_t(int, const void*, size_t, off_t)>("pwrite")(file, bytes, most, offset);
  });
}

ssize_t pwrite64(int file, const void* bytes, size_t size, off64_t offset) {
  return on_file(file, Call::write, size, [&](size_t most) {
    return real<ssize_t(int, const void*, size_t, off64_t)>("pwrite64")(file, bytes, most, offset);
  });
}

int fsync(int file) { return sync_watched("fsync", file); }
int fdatasync(int file) { return sync_watched("fdatasync", file); }

int ftruncate64(int file, off64_t size) noexcept {
  return static_cast<int>(on_file(file, Call::other, 0, [&](size_t) -> ssize_t {
    return real<int(int, off64_t)>("ftruncate64")(file, size);
  }));
}

int mkdir(const char* path, mode_t mode) noexcept {
  return on_path(path, Call::other, [&] {
    const int result = real<int(const char*, mode_t)>("mkdir")(path, mode);
    if (result == 0) note_entry(path);
    return result;
  });
}

int rename(const char* from, const char* to) noexcept {
  return on_path(to, Call::other, [&] {
    const int result = real<int(const char*, const char*)>("rename")(from, to);
    if (result == 0) note_entry(to);
    return result;
  });
}

int unlink(const char* path) noexcept {
  return on_path(path, Call::other, [&] { return real<int(const char*)>("unlink")(path); });
}
}
