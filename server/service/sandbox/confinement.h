// Taking everything from a process that it doesn't need to turn bytes into other bytes.
#pragma once

#include <cstdint>

namespace fogbank::service {

struct ReaderLimits {
  /// Above what the program itself takes: address space, since that is what an allocation can be refused by.
  static constexpr uint64_t memory_bytes = uint64_t{12} << 30;
  static constexpr uint64_t cpu_seconds = 300;
  /// Without a byte of an answer.
  static constexpr int64_t silence_seconds = 600;
};

/// Which layers are in force. Limits of resources always are.
struct Confinement {
  uint8_t system_calls = 0;  ///< seccomp: no new files, sockets, processes or executable memory
  uint8_t files = 0;         ///< Landlock: no paths
};

/// Confines the calling process, which has one thread so far, for good: it may go on to read and write what
/// is open, and to take memory. Containers may forbid the one or the other layer.
Confinement confine_this_process();

}  // namespace fogbank::service
