// Taking everything from a process that it doesn't need to turn bytes into other bytes.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace fogbank::service {

struct ReaderLimits {
  /// Above what the program itself takes: address space, since that is what an allocation can be refused by.
  static constexpr uint64_t memory_bytes = uint64_t{12} << 30;
  static constexpr uint64_t cpu_seconds = 300;
  /// Without a byte of an answer.
  static constexpr int64_t silence_seconds = 600;
};

/// What each layer said when it was asked for: 0 where it is in force, else an errno. Containers may forbid
/// one or the other.
struct Confinement {
  int32_t limits_error = 0;    ///< setrlimit: memory, processor time, descriptors, size of files
  int32_t seccomp_error = 0;   ///< no new files, sockets, processes or executable memory
  int32_t landlock_error = 0;  ///< no paths
};

/// Confines the calling process, which has one thread so far, for good: it may go on to read and write what
/// is open, and to take memory.
Confinement confine_this_process();

struct ConfinementLayer {
  const char* name;     ///< "rlimits", "seccomp", "landlock"
  std::string problem;  ///< why it is not in force; empty: it is
};
std::array<ConfinementLayer, 3> layers_of(const Confinement& confinement);

}  // namespace fogbank::service
