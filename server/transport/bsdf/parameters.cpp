#include "transport/bsdf/parameters.h"

#include <algorithm>
#include <cctype>

#include "scene/text.h"

namespace fogbank::transport {

namespace {

constexpr double least_index = 0.1;
constexpr double largest_index = 100;

float read_index(scene::PropertyReader& reader, std::string_view name, std::string_view fallback) {
  const scene::PropertyValue* value = reader.raw(name);
  if (value != nullptr && !std::holds_alternative<std::string>(*value))
    return static_cast<float>(reader.number(name, 1.0, least_index, largest_index));
  const std::string material = reader.text(name, std::string(fallback));
  const std::optional<float> index = named_index_of_refraction(material);
  if (!index)
    reader.fail_at(name, "UNKNOWN_MATERIAL",
                   scene::quote(material) + " is not a dielectric Fogbank knows; supported: " +
                       named_indices_of_refraction() + ", or a number");
  return *index;
}

}  // namespace

ColorParameter read_reflectance(scene::PropertyReader& reader, BsdfBuilder& builder, std::string_view name,
                                float fallback) {
  return ColorParameter(
      scene::read_texture(reader, name, Spectrum(fallback), 0.0f, 1.0f, builder.textures()));
}

NumberParameter read_number(scene::PropertyReader& reader, BsdfBuilder& builder, std::string_view name,
                            float fallback, float lowest, float highest) {
  return NumberParameter(
      scene::read_texture(reader, name, Spectrum(fallback), lowest, highest, builder.textures()));
}

float read_relative_index(scene::PropertyReader& reader, std::string_view interior) {
  const float inside = read_index(reader, "int_ior", interior);
  return inside / read_index(reader, "ext_ior", "air");
}

float read_unequal_relative_index(scene::PropertyReader& reader, std::string_view interior) {
  const float eta = read_relative_index(reader, interior);
  if (eta == 1.0f)
    reader.fail("INDICES_EQUAL", "int_ior and ext_ior must differ; an index-matched boundary is a null BSDF");
  return eta;
}

ConductorParameters read_conductor(scene::PropertyReader& reader, BsdfBuilder& builder) {
  constexpr float largest = 100;
  const std::string material = reader.text("material", "none");
  const bool given = reader.has("eta") || reader.has("k");
  if (given && material != "none")
    reader.fail("CONFLICTING_PARAMETERS", "give either 'material' or 'eta' and 'k', not both");
  const std::optional<ConductorIndex> preset = named_conductor(material);
  if (!preset)
    reader.fail_at(
        "material", "UNKNOWN_MATERIAL",
        scene::quote(material) + " is not a conductor Fogbank knows; supported: " + named_conductors());
  return {ColorParameter(scene::read_texture(reader, "eta", preset->eta, 0.0f, largest, builder.textures())),
          ColorParameter(scene::read_texture(reader, "k", preset->k, 0.0f, largest, builder.textures()))};
}

MicrofacetType read_microfacet_type(scene::PropertyReader& reader) {
  reader.boolean("sample_visible", true);
  std::string name = reader.text("distribution", "beckmann");
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (name == "beckmann") return MicrofacetType::beckmann;
  if (name == "ggx") return MicrofacetType::ggx;
  reader.fail_at(
      "distribution", "UNKNOWN_CHOICE",
      scene::quote(name) + " is not a microfacet distribution Fogbank knows; supported: beckmann, ggx");
}

RoughnessParameters read_roughness(scene::PropertyReader& reader, BsdfBuilder& builder) {
  if (reader.has("alpha_u") || reader.has("alpha_v")) {
    if (reader.has("alpha"))
      reader.fail("CONFLICTING_PARAMETERS", "give either 'alpha' or 'alpha_u' and 'alpha_v', not both");
    if (!reader.has("alpha_u") || !reader.has("alpha_v"))
      reader.fail("MISSING_PARAMETER", "'alpha_u' and 'alpha_v' must be given together");
    return {read_number(reader, builder, "alpha_u", 0.1f, 0.0f, largest_alpha),
            read_number(reader, builder, "alpha_v", 0.1f, 0.0f, largest_alpha)};
  }
  NumberParameter alpha = read_number(reader, builder, "alpha", 0.1f, 0.0f, largest_alpha);
  return {alpha, alpha};
}

std::vector<BsdfPointer> read_nested(scene::PropertyReader& reader, BsdfBuilder& builder, size_t least,
                                     size_t most) {
  const std::vector<scene::ObjectPointer> children = reader.children("bsdf");
  if (children.size() < least || children.size() > most) {
    const std::string wanted =
        least == most ? std::to_string(least) : std::to_string(least) + " or " + std::to_string(most);
    reader.fail("WRONG_NUMBER_OF_BSDFS",
                "needs " + wanted + " nested <bsdf>, has " + std::to_string(children.size()));
  }
  std::vector<BsdfPointer> nested;
  nested.reserve(children.size());
  for (const scene::ObjectPointer& child : children) nested.push_back(builder.build(child));
  return nested;
}

}  // namespace fogbank::transport
