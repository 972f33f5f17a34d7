#include "service/build_id.h"

#include "core/files.h"
#include "core/sha256.h"

namespace fogbank::service {

const std::string& build_id() {
  constexpr int64_t max_program_bytes = 1 << 30;
  static const std::string id = sha256(read_file("/proc/self/exe", max_program_bytes)).substr(0, 16);
  return id;
}

}  // namespace fogbank::service
