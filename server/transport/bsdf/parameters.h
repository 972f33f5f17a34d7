// Reading of the parameters that several BSDFs share.
#pragma once

#include <string_view>
#include <vector>

#include "transport/bsdf.h"
#include "transport/bsdf/texture_parameter.h"
#include "transport/material_presets.h"
#include "transport/microfacet.h"

namespace fogbank::transport {

/// Largest roughness accepted: far beyond what looks like anything, but below where floats give out.
inline constexpr float largest_alpha = 10;

/// Reflectance-like colour called `name`, each channel in [0, 1].
ColorParameter read_reflectance(scene::PropertyReader& reader, BsdfBuilder& builder, std::string_view name,
                                float fallback);
/// Number or texture called `name` in [lowest, highest].
NumberParameter read_number(scene::PropertyReader& reader, BsdfBuilder& builder, std::string_view name,
                            float fallback, float lowest, float highest);

/// `int_ior` over `ext_ior`: each a number in [0.1, 100] or a material's name; `interior` names the default
/// of the former, the latter's is air. Throws UNKNOWN_MATERIAL for an unknown name.
float read_relative_index(scene::PropertyReader& reader, std::string_view interior);
/// As `read_relative_index`; throws INDICES_EQUAL when the two are equal, as rough interfaces then have no
/// distribution of directions.
float read_unequal_relative_index(scene::PropertyReader& reader, std::string_view interior);

/// `material` (a preset's name) or else `eta` (default 0) and `k` (default 1), each a colour or texture in
/// [0, 100]. Throws UNKNOWN_MATERIAL, or CONFLICTING_PARAMETERS when both forms are given.
struct ConductorParameters {
  ColorParameter eta;
  ColorParameter k;
};
ConductorParameters read_conductor(scene::PropertyReader& reader, BsdfBuilder& builder);

/// `distribution`: "beckmann" (default) or "ggx", whatever the case. Reads and ignores `sample_visible`:
/// visible normals are always sampled, which changes noise only.
MicrofacetType read_microfacet_type(scene::PropertyReader& reader);

/// `alpha` (default 0.1), or else `alpha_u` and `alpha_v`, each a number or texture in [0, 10]; values below
/// MicrofacetDistribution::least_alpha act as that. Throws CONFLICTING_PARAMETERS for `alpha` with one of the
/// others, MISSING_PARAMETER for only one of the two.
struct RoughnessParameters {
  NumberParameter alpha_u;
  NumberParameter alpha_v;
};
RoughnessParameters read_roughness(scene::PropertyReader& reader, BsdfBuilder& builder);

/// The nested BSDFs, built; throws WRONG_NUMBER_OF_BSDFS unless there are `least` to `most` of them.
std::vector<BsdfPointer> read_nested(scene::PropertyReader& reader, BsdfBuilder& builder, size_t least,
                                     size_t most);

}  // namespace fogbank::transport
