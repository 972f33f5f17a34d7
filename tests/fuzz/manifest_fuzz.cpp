// Manifests of caches: as they are, and with the checksum that someone who knows the format would write.
#include <xxhash.h>

#include "cache/store/manifest.h"
#include "fuzz.h"

using namespace fogbank;

namespace {

void check(const std::string& text) {
  cache::Manifest manifest;
  if (!fuzz::accepts([&] { manifest = cache::parse_manifest(text, "manifest"); })) return;
  const std::string written = cache::to_text(manifest);
  fuzz::require(cache::to_text(cache::parse_manifest(written, "manifest")) == written,
                "it reads back the same");
}

}  // namespace

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  const std::string text = fuzz::bytes_of(data, size);
  check(text);
  const std::string lines = text.substr(0, text.rfind("checksum "));
  char checksum[40];
  std::snprintf(checksum, sizeof checksum, "checksum %016llx\n",
                static_cast<unsigned long long>(XXH3_64bits(lines.data(), lines.size())));
  check(lines + checksum);
  return 0;
}
