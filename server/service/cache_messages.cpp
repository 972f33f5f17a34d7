#include "service/cache_messages.h"

#include "service/names.h"

namespace fogbank::service {

namespace {

v1::RecordQuantity to_message(cache::Quantity quantity) {
  switch (quantity) {
    case cache::Quantity::rest:
      return v1::RECORD_QUANTITY_REST;
    case cache::Quantity::irradiance:
      return v1::RECORD_QUANTITY_IRRADIANCE;
    case cache::Quantity::ratio:
      return v1::RECORD_QUANTITY_RATIO;
    case cache::Quantity::unaware_rest:
      return v1::RECORD_QUANTITY_UNAWARE_REST;
    case cache::Quantity::unaware_direct:
      return v1::RECORD_QUANTITY_UNAWARE_DIRECT;
    case cache::Quantity::directional_rest:
      return v1::RECORD_QUANTITY_DIRECTIONAL_REST;
  }
  return v1::RECORD_QUANTITY_UNSPECIFIED;
}

v1::CacheComponent to_message(const cache::Component& component, uint64_t records) {
  v1::CacheComponent message;
  message.set_quantity(to_message(component.quantity));
  message.set_medium(component.medium);
  message.set_light_group(component.light_group);
  message.set_generation(component.scattering_order);
  message.set_records(static_cast<int64_t>(records));
  return message;
}

}  // namespace

v1::CacheComponent to_message(const cache::ComponentRange& range) {
  return to_message(range.component, range.record_count);
}

v1::Cache to_message(const cache::CacheSummary& summary) {
  v1::Cache message;
  message.set_name(cache_name(summary.transport));
  message.set_records(static_cast<int64_t>(summary.records));
  for (const cache::ComponentCount& count : summary.components)
    *message.add_components() = to_message(count.component, count.records);
  message.set_epoch(summary.epoch);
  message.set_disk_bytes(static_cast<int64_t>(summary.bytes + summary.quarantined_bytes));
  message.set_segments(static_cast<int32_t>(summary.segments.size()));
  message.mutable_last_use_time()->set_seconds(summary.used_at);
  return message;
}

}  // namespace fogbank::service
