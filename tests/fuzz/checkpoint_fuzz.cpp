// Checkpoints: as they are, and with the hash that someone who knows the format would write.
#include <sys/mman.h>

#include "core/files.h"
#include "core/sha256.h"
#include "fuzz.h"
#include "render/checkpoint.h"

using namespace fogbank;

namespace {

constexpr size_t digest_bytes = 64;

void check(const std::string& bytes) {
  const FileDescriptor file(::memfd_create("checkpoint", MFD_CLOEXEC));
  const std::string path = "/proc/self/fd/" + std::to_string(file.get());
  write_all(file, bytes, path);
  fuzz::accepts([&] {
    const render::Checkpoint checkpoint = render::read_checkpoint(path, "identity");
    for (const auto& tile : checkpoint.tiles) fuzz::require(tile != nullptr, "a tile is a film");
  });
}

}  // namespace

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string bytes = fuzz::bytes_of(data, size);
  check(bytes);
  const std::string hashed = bytes.substr(0, bytes.size() - std::min(bytes.size(), digest_bytes));
  check(hashed + sha256(hashed));
  return 0;
}
