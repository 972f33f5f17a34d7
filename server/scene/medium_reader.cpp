#include "scene/medium_reader.h"

#include <limits>

#include "scene/text.h"

namespace fogbank::scene {
namespace {

/// Optical thickness of a unit length; far above it nothing but rounding errors is left of exp(-sigma_t d).
constexpr float largest_coefficient = 1e10f;

[[noreturn]] void refuse_volume(const SourceLocation& where, const std::string& type) {
  throw SceneError(ErrorKind::unsupported, "HETEROGENEOUS_MEDIUM_UNSUPPORTED", where,
                   "heterogeneous media (" + quote(type) +
                       ") are not supported yet; supported: homogeneous, with constvolume at most");
}

/// A float, colour or `constvolume`.
Spectrum coefficient(PropertyReader& reader, const char* name, const Spectrum& fallback, float highest,
                     std::vector<std::string>* warnings) {
  const Property* property = reader.object().find(name);
  const auto* nested = property ? std::get_if<ObjectPointer>(&property->value) : nullptr;
  if (!nested) return reader.spectrum(name, fallback, 0.0f, highest);
  const ObjectPointer volume = reader.child(name, "volume");
  if (volume->type != "constvolume") refuse_volume(volume->where, volume->type);
  PropertyReader volume_reader(*volume);
  if (!volume_reader.has("value")) volume_reader.fail("MISSING_PARAMETER", "parameter 'value' is missing");
  const Spectrum value = volume_reader.spectrum("value", fallback, 0.0f, highest);
  volume_reader.finish(warnings);
  return value;
}

}  // namespace

Medium read_medium(const ObjectDescription& description, std::vector<std::string>* warnings) {
  if (description.type == "heterogeneous") refuse_volume(description.where, description.type);
  PropertyReader reader(description);
  if (description.type != "homogeneous")
    reader.fail("UNKNOWN_PLUGIN",
                "medium " + quote(description.type) + " is not supported; supported: homogeneous");

  Medium medium;
  medium.id = description.id;
  const auto scale = static_cast<float>(reader.number("scale", 1.0, 0.0, largest_coefficient));
  const bool is_split = reader.has("sigma_s") || reader.has("sigma_a");
  if (is_split && (reader.has("sigma_t") || reader.has("albedo")))
    reader.fail("CONFLICTING_PARAMETERS",
                "give either 'sigma_t' and 'albedo' or 'sigma_s' and 'sigma_a', not both");
  if (is_split) {
    const Spectrum sigma_s = coefficient(reader, "sigma_s", Spectrum(0), largest_coefficient, warnings);
    const Spectrum sigma_a = coefficient(reader, "sigma_a", Spectrum(0), largest_coefficient, warnings);
    medium.sigma_t = sigma_s + sigma_a;
    for (int channel = 0; channel < 3; ++channel)
      medium.albedo[channel] =
          medium.sigma_t[channel] > 0 ? sigma_s[channel] / medium.sigma_t[channel] : 0.0f;
  } else {
    medium.sigma_t = coefficient(reader, "sigma_t", Spectrum(1), largest_coefficient, warnings);
    medium.albedo = coefficient(reader, "albedo", Spectrum(0.75f), 1.0f, warnings);
  }
  medium.sigma_t *= scale;
  if (max_component(medium.sigma_t) > largest_coefficient)
    reader.fail("OUT_OF_RANGE",
                "'sigma_t' times 'scale' must be at most " + number_text(largest_coefficient));

  const std::vector<ObjectPointer> phases = reader.children("phase");
  if (phases.size() > 1) reader.fail("DUPLICATE_PARAMETER", "a medium has one <phase>");
  if (!phases.empty()) medium.phase = phases.front();
  reader.finish(warnings);
  return medium;
}

}  // namespace fogbank::scene
