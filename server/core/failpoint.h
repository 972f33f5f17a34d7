// Places where tests make the program fail. Only builds with FOGBANK_FAILPOINTS have them; elsewhere nothing
// is left of them, their names included.
#pragma once

#ifdef FOGBANK_FAILPOINTS

namespace fogbank {

/// What the environment variable FOGBANK_FAILPOINTS says of this name, NAME=ACTION[@N] after commas, is done:
/// at the N-th time only, or each time. `panic` ends the process as kill -9 does, `delay:MS` sleeps,
/// `error:ENOSPC` and `error:EIO` throw as a file operation that fails so (core/files.h). Each time it is
/// said on standard error. Thread-safe.
void reach_failpoint(const char* name);

}  // namespace fogbank

#define FOGBANK_FAILPOINT(name) ::fogbank::reach_failpoint(name)
#else
#define FOGBANK_FAILPOINT(name) static_cast<void>(0)
#endif
