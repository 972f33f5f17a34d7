// The process that takes the files of one scene apart.
#pragma once

#include "service/sandbox/socket.h"

namespace fogbank::service {

/// Answers requests (encoding.h) until the other end is closed. The calling process has one thread and is
/// confined.
void read_scene_files(const Socket& server);

}  // namespace fogbank::service
