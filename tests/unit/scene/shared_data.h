// Data that is shared between projects and not part of this repository.
#pragma once

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

namespace fogbank::test {

/// Path of `name` below the shared folder: FOGBANK_SHARED, or ../shared seen from the repository (tests run
/// in its root).
inline std::string shared_path(const std::string& name) {
  const char* root = std::getenv("FOGBANK_SHARED");
  return (root != nullptr ? std::string(root) : "../shared") + "/" + name;
}

/// False, with the bytes untouched, when the file isn't there.
inline bool read_shared(const std::string& name, std::string& bytes) {
  std::ifstream file(shared_path(name), std::ios::binary);
  if (!file) return false;
  bytes.assign(std::istreambuf_iterator<char>(file), {});
  return true;
}

}  // namespace fogbank::test
