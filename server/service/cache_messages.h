// Caches in wire form.
#pragma once

#include "cache/record_set.h"
#include "fogbank/v1/cache.pb.h"

namespace fogbank::service {

v1::CacheComponent to_message(const cache::ComponentRange& range);

}  // namespace fogbank::service
