// Record makers by quantity. A new one is its own file and one line here.
#include "cache/record_maker.h"
#include "cache/record_makers/irradiance.h"
#include "cache/record_makers/ratio.h"
#include "cache/record_makers/rest.h"
#include "cache/record_makers/unaware.h"
#include "core/error.h"

namespace fogbank::cache {

std::unique_ptr<RecordMaker> make_record_maker(Quantity quantity,
                                               std::shared_ptr<const transport::World> world,
                                               const RecordMakerSettings& settings) {
  switch (quantity) {
    case Quantity::rest:
    case Quantity::directional_rest:
      return std::make_unique<RestRecordMaker>(std::move(world), settings);
    case Quantity::irradiance:
      return std::make_unique<IrradianceRecordMaker>(std::move(world), settings);
    case Quantity::unaware_rest:
    case Quantity::unaware_direct:
      return std::make_unique<UnawareRecordMaker>(quantity, std::move(world), settings);
    case Quantity::ratio:
      return std::make_unique<RatioRecordMaker>(std::move(world), settings);
    default:
      throw Error(ErrorKind::invalid_argument, "INVALID_SETTINGS",
                  "record maker: nobody makes this quantity");
  }
}

}  // namespace fogbank::cache
