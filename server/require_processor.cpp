// Ends fogbankd with a clear message on a processor that lacks the instructions it was compiled for; without
// it the user would see "Illegal instruction". Compiled for the baseline processor (server/CMakeLists.txt).
#include <unistd.h>

#include <cstring>

namespace {

/// EX_UNAVAILABLE of sysexits.h, which clients map to "the server cannot run here".
constexpr int exit_code_unavailable = 69;

// Priority 101 is the first that is open to programs: before every static initialiser of this executable, any
// of which may hold the instructions in question. No library but libc may be used here.
__attribute__((constructor(101))) void require_processor() {
  __builtin_cpu_init();
  if (__builtin_cpu_supports(FOGBANK_REQUIRED_PROCESSOR)) return;
  const char message[] = "fogbankd: error: this build needs a processor with the " FOGBANK_REQUIRED_PROCESSOR
                         " instructions (AVX2, FMA, BMI2), which this one lacks; "
                         "build with cmake -DFOGBANK_MARCH=x86-64 to run here\n";
  // Nothing is left to do if even this write fails.
  [[maybe_unused]] const ssize_t written = write(STDERR_FILENO, message, std::strlen(message));
  _exit(exit_code_unavailable);
}

}  // namespace
