// Where the bytes of a scene's files come from: a folder, or uploaded blobs. Nothing else is ever opened.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/files.h"

namespace fogbank::scene {

/// Read access to the files of one scene by logical path: relative to the scene's root, '/'-separated,
/// normalised, never with "..". `resolve` turns a reference as written in a file into such a path.
class FileSource {
 public:
  virtual ~FileSource() = default;
  virtual bool exists(const std::string& path) const = 0;
  /// Whole file. Throws Error(not_found / resource_exhausted / data_loss) when it can't be read or is over
  /// the size limit.
  virtual std::string read(const std::string& path) const = 0;

  /// Every path that was asked for and not found, in order; PrepareScene reports these to the client.
  const std::vector<std::string>& missing() const { return missing_; }
  void note_missing(const std::string& path) { missing_.push_back(path); }

 private:
  std::vector<std::string> missing_;
};

/// Files that have a place on the disk.
class StoredFiles : public FileSource {
 public:
  /// A file for reading, which is a regular one of at most LoadLimits::file_bytes. Throws as `read`.
  virtual FileDescriptor open(const std::string& path) const = 0;
  std::string read(const std::string& path) const final;
};

/// Whole contents of an open file; `path` is its name in messages. Throws Error as FileSource::read.
std::string read_opened_file(const FileDescriptor& file, const std::string& path);

/// Files below `root`; symbolic links that lead out of it, devices and FIFOs are refused.
std::shared_ptr<StoredFiles> folder_source(const std::string& root);

/// Files by content: logical path -> absolute path of the blob that holds it.
std::shared_ptr<StoredFiles> blob_source(std::map<std::string, std::string> blobs);

/// Joins `reference` (as written in the file `from`) to a logical path: relative to the folder of `from`.
/// Backslashes become slashes, "." and ".." are folded. Throws Error(invalid_argument, "PATH_OUTSIDE_ROOT")
/// when it leads out of the root, is absolute, has a scheme, a NUL or control characters, or is longer than
/// 1024 bytes.
std::string resolve_path(const std::string& from, const std::string& reference);

}  // namespace fogbank::scene
