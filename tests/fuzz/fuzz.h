// What the fuzz targets share. A target is handed bytes; it finds something when it crashes, hangs, takes
// more memory than it may, does what the sanitizers object to, or when `require` does not hold.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "core/error.h"

// The two functions that libFuzzer calls.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv);

namespace fogbank::fuzz {

inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", what);
  std::abort();
}

inline std::string bytes_of(const uint8_t* data, size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

/// False where `action` refuses the input as it should: by an Error that says why.
template <typename Action>
bool accepts(const Action& action) {
  try {
    action();
    return true;
  } catch (const Error& error) {
    require(!error.reason().empty() && error.kind() != ErrorKind::internal, error.what());
    return false;
  }
}

}  // namespace fogbank::fuzz
