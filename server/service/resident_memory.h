// Memory of this process.
#pragma once

#include <cstdint>

namespace fogbank::service {

/// Resident, in bytes; 0 where the system does not say.
int64_t resident_memory_bytes();

}  // namespace fogbank::service
