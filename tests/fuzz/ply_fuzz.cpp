// PLY meshes.
#include "mesh_checks.h"

using namespace fogbank;

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  fuzz::check_reader(
      [&](const scene::MeshReadOptions& options) { return scene::read_ply(bytes, options, {}); });
  return 0;
}
