// Which build this is.
#pragma once

#include <string>

namespace fogbank::service {

/// Hash of the running program, 16 hexadecimal digits: nothing else says so surely that two servers are the
/// same build. Read once, at the first call.
const std::string& build_id();

}  // namespace fogbank::service
