// Caches in wire form.
#pragma once

#include "cache/record_set.h"
#include "cache/store/store.h"
#include "fogbank/v1/cache.pb.h"

namespace fogbank::service {

v1::CacheComponent to_message(const cache::ComponentRange& range);

/// Everything but the memory.
v1::Cache to_message(const cache::CacheSummary& summary);

}  // namespace fogbank::service
