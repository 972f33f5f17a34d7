#include "service/cache_messages.h"

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
  }
  return v1::RECORD_QUANTITY_UNSPECIFIED;
}

}  // namespace

v1::CacheComponent to_message(const cache::ComponentRange& range) {
  v1::CacheComponent message;
  message.set_quantity(to_message(range.component.quantity));
  message.set_medium(range.component.medium);
  message.set_light_group(range.component.light_group);
  message.set_generation(range.component.scattering_order);
  message.set_records(static_cast<int64_t>(range.record_count));
  return message;
}

}  // namespace fogbank::service
