// The BSDF plugins by name.
#include <algorithm>
#include <iterator>

#include "scene/text.h"
#include "transport/bsdf.h"
#include "transport/bsdf/factories.h"
#include "transport/rough_interface.h"

namespace fogbank::transport {

namespace {

using Factory = BsdfPointer (*)(scene::PropertyReader&, BsdfBuilder&);

struct Entry {
  const char* name;
  Factory make;
};

constexpr Entry registry[] = {
    {"blendbsdf", make_blend},
    {"bumpmap", make_bump_map},
    {"conductor", make_conductor},
    {"dielectric", make_dielectric},
    {"diffuse", make_diffuse},
    {"mask", make_mask},
    {"normalmap", make_normal_map},
    {"null", make_null},
    {"plastic", make_plastic},
    {"principled", make_principled},
    {"roughconductor", make_rough_conductor},
    {"roughdielectric", make_rough_dielectric},
    {"roughplastic", make_rough_plastic},
    {"thindielectric", make_thin_dielectric},
    {"twosided", make_two_sided},
};

/// A BSDF deeper than this is a mistake or an attack: evaluation doubles with each level of `blendbsdf`.
constexpr int32_t largest_depth = 16;

/// Counts a level of nesting for as long as it lives, also when building throws.
class DepthGuard {
 public:
  explicit DepthGuard(int32_t& depth) : depth_(depth) { ++depth_; }
  ~DepthGuard() { --depth_; }
  DepthGuard(const DepthGuard&) = delete;
  DepthGuard& operator=(const DepthGuard&) = delete;

 private:
  int32_t& depth_;
};

}  // namespace

BsdfBuilder::BsdfBuilder(scene::TextureLibrary& textures, bool lenient, std::vector<std::string>& warnings)
    : textures_(textures), lenient_(lenient), warnings_(warnings) {}

BsdfPointer BsdfBuilder::build(const scene::ObjectPointer& description) {
  const auto found = built_.find(description.get());
  if (found != built_.end()) return found->second.second;

  const DepthGuard guard(depth_);
  if (depth_ > largest_depth)
    throw SceneError(ErrorKind::invalid_argument, "BSDF_NESTED_TOO_DEEPLY", description->where,
                     "BSDFs are nested more than " + std::to_string(largest_depth) + " levels deep");
  const auto entry = std::find_if(std::begin(registry), std::end(registry),
                                  [&](const Entry& e) { return description->type == e.name; });
  BsdfPointer bsdf;
  if (entry != std::end(registry)) {
    scene::PropertyReader reader(*description);
    bsdf = entry->make(reader, *this);
    reader.finish(lenient_ ? &warnings_ : nullptr);
  } else {
    const std::string message =
        scene::quote(description->type) +
        " is not a BSDF Fogbank knows; supported: " + scene::list_names(supported_bsdfs()) +
        scene::did_you_mean(description->type, supported_bsdfs());
    if (!lenient_) throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_BSDF", description->where, message);
    warnings_.push_back(description->where.to_string() + ": " + message +
                        "; diffuse with reflectance 0.5 stands in");
    const scene::ObjectDescription stand_in{"bsdf", "diffuse", description->id, description->where, {}};
    scene::PropertyReader reader(stand_in);
    bsdf = make_diffuse(reader, *this);
  }
  built_.emplace(description.get(), std::pair(description, bsdf));
  return bsdf;
}

std::shared_ptr<const RoughInterface> BsdfBuilder::rough_interface(MicrofacetType type, float alpha,
                                                                   float eta) {
  std::shared_ptr<const RoughInterface>& found = rough_interfaces_[{type, alpha, eta}];
  if (found == nullptr) found = std::make_shared<RoughInterface>(type, alpha, eta);
  return found;
}

std::vector<std::string> supported_bsdfs() {
  std::vector<std::string> names;
  for (const Entry& entry : registry) names.emplace_back(entry.name);
  return names;
}

}  // namespace fogbank::transport
