// What a radiance cache needs, besides its records, to go on where another one stood.
#include <cmath>

#include "cache/record_bytes.h"
#include "integrators/radiance_cache_fill.h"

namespace fogbank::integrators {

// The rest follows from these: the metric from pilot and error, photons and maps of shadows from the scene.
std::optional<std::string> RadianceCacheIntegrator::state() const {
  if (!published_.epoch) return std::nullopt;
  std::string bytes;
  cache::append_bytes(bytes, published_.error);
  cache::append_bytes(bytes, published_.generation);
  cache::append_bytes(bytes, records_at_start_);
  cache::append_bytes(bytes, records_new_);
  const RatioPlaces& ratios = single_scattering_.ratios_then();
  cache::append_bytes(bytes, static_cast<uint32_t>(ratios.size()));
  for (const uint64_t places : ratios) cache::append_bytes(bytes, places);
  cache::append_bytes(bytes, pilot_.count());
  for (uint32_t place = 0; place < pilot_.count(); ++place) pilot_.append_to(bytes, place);
  return bytes;
}

void RadianceCacheIntegrator::restore(const CameraRays& camera, std::string_view state) {
  cache::ByteReader reader(state);
  const auto error = reader.take<double>();
  if (!(error > 0) || !std::isfinite(error)) cache::refuse_poisoned("a target is no error");
  const auto generation = reader.take<uint8_t>();
  if (generation > 1) cache::refuse_poisoned("there is no such generation");
  const auto at_start = reader.take<uint64_t>();
  const auto made = reader.take<uint64_t>();
  RatioPlaces ratios(cache::take_count(reader, sizeof(uint64_t)));
  for (uint64_t& places : ratios) places = reader.take<uint64_t>();
  if (cache::take_count(reader, 1) != pilot_.count()) cache::refuse_poisoned("the pilot has other places");
  for (uint32_t place = 0; place < pilot_.count(); ++place)
    pilot_.set(place, pilot_.take_record(reader, place));
  cache::expect_end(reader);

  if (technique_.aware) single_scattering_.decide(settings_, camera, std::move(ratios));
  single_scattering_.map_shadows(camera);
  RadianceCacheFill(*this, camera, {.error = error}).publish_as_it_is(generation);
  records_at_start_ = at_start;
  records_new_ = made;
}

}  // namespace fogbank::integrators
