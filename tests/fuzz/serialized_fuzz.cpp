// Mitsuba's .serialized meshes: files as they are, and the input as what a file holds compressed, since
// hardly any change of a compressed stream gets past zlib.
#include <zlib.h>

#include <vector>

#include "mesh_checks.h"

using namespace fogbank;

namespace {

/// A file of version 4 whose only mesh is `contents`.
std::string file_around(const std::string& contents) {
  uLongf size = compressBound(contents.size());
  std::vector<Bytef> compressed(size);
  fuzz::require(compress2(compressed.data(), &size, reinterpret_cast<const Bytef*>(contents.data()),
                          contents.size(), 1) == Z_OK,
                "zlib compresses");
  std::string file("\x1c\x04\x04\x00", 4);
  file.append(reinterpret_cast<const char*>(compressed.data()), size);
  file.append(8, '\0');                // offset of the mesh
  file.append("\x01\x00\x00\x00", 4);  // number of meshes
  return file;
}

void check(const std::string& file) {
  for (const int64_t index : {0, 1})
    fuzz::check_reader([&](const scene::MeshReadOptions& options) {
      return scene::read_serialized(file, index, options, {});
    });
}

}  // namespace

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  check(bytes);
  check(file_around(bytes));
  return 0;
}
