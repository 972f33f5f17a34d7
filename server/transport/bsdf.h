// The interface of surface scattering. One file per BSDF in bsdf/, one line each in bsdf_registry.cpp.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <unordered_map>
#include <utility>
#include <vector>

#include "core/frame.h"
#include "core/vector.h"
#include "scene/description.h"
#include "scene/texture.h"

namespace fogbank::transport {

class RoughInterface;
enum class MicrofacetType : uint8_t;

/// What a BSDF may look at. Directions given to a BSDF are unit vectors in the local frame of `frame`.
struct ShadingPoint {
  Frame frame;                      ///< shading frame; tangent along dp_du
  Vec3f geometric_normal{0, 0, 1};  ///< world space, same orientation as the surface's outside
  Vec2f uv{0};
  Vec3f dp_du{1, 0, 0};  ///< world space
  Vec3f dp_dv{0, 1, 0};
};

struct BsdfSample {
  Vec3f wi{0, 0, 1};  ///< sampled direction, local
  Spectrum weight{
      0};         ///< f(wo, wi) |cos theta_i| / pdf; for a delta lobe the lobe's weight over its probability
  float pdf = 0;  ///< per solid angle over all non-delta lobes; for a delta lobe the discrete probability
  float eta = 1;  ///< relative index of refraction along the transmitted path (1 for reflection)
  bool delta = false;  ///< drawn from a Dirac lobe
  bool null = false;   ///< passed straight through: not a scattering event
};

/// What a BSDF says about one pair of directions.
struct BsdfValue {
  Spectrum value{0};  ///< f(wo, wi) |cos theta_i| of all non-delta lobes, 1/sr
  float pdf = 0;      ///< density of `sample` for wi per solid angle, non-delta lobes only (times their
                      ///< probability of being chosen)
};

/// Immutable; safe from any thread. Transport mode is radiance: rough and smooth refraction scale by 1 /
/// eta^2. Energy: for every wo the sample's expected weight is <= 1 per channel (dielectrics: up to the eta^2
/// radiance scale).
class Bsdf {
 public:
  virtual ~Bsdf() = default;

  /// Value and density for the directions `wo` (to where the path came from) and `wi` (to the light); both 0
  /// where nothing scatters. In one call because next-event estimation and the integrators always need both.
  virtual BsdfValue evaluate_with_pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const = 0;
  Spectrum evaluate(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const {
    return evaluate_with_pdf(point, wo, wi).value;
  }
  float pdf(const ShadingPoint& point, const Vec3f& wo, const Vec3f& wi) const {
    return evaluate_with_pdf(point, wo, wi).pdf;
  }
  /// Draws a direction; nullopt when the path ends. `lobe` and `direction` are canonical random numbers.
  virtual std::optional<BsdfSample> sample(const ShadingPoint& point, const Vec3f& wo, float lobe,
                                           const Vec2f& direction) const = 0;
  /// Share of light that goes straight on (null, mask, thindielectric); shadow rays multiply by it. In [0,
  /// 1].
  virtual Spectrum null_transmission(const ShadingPoint&, const Vec3f& /*wo*/) const { return Spectrum(0); }
  /// Does light get through to the other side, bent or straight?
  virtual bool transmits() const { return false; }
  /// Has lobes that next-event estimation can reach?
  virtual bool has_smooth_lobes() const = 0;
  /// Reflectance rho where, for `wo`, the BSDF is rho / pi for all directions on wo's side and nothing else:
  /// irradiance is all that such a surface needs to know of the light. nullopt for any other.
  virtual std::optional<Spectrum> lambertian_reflectance(const ShadingPoint&, const Vec3f& /*wo*/) const {
    return std::nullopt;
  }
  /// Mean reflectance, for plans and sampling weights only.
  virtual Spectrum albedo_estimate() const = 0;
};
using BsdfPointer = std::shared_ptr<const Bsdf>;

/// Builds BSDFs of one scene; nested and referenced descriptions are built once and shared.
class BsdfBuilder {
 public:
  /// `lenient`: an unknown plugin becomes diffuse 0.5 and an unknown parameter is ignored, each with a
  /// warning.
  BsdfBuilder(scene::TextureLibrary& textures, bool lenient, std::vector<std::string>& warnings);

  /// Throws SceneError for an unknown plugin (naming the supported ones) and for anything wrong in its
  /// parameters.
  BsdfPointer build(const scene::ObjectPointer& description);

  /// Tables of a rough coat (see rough_interface.h), computed once for each distribution, roughness and
  /// index.
  std::shared_ptr<const RoughInterface> rough_interface(MicrofacetType type, float alpha, float eta);

  scene::TextureLibrary& textures() { return textures_; }
  bool lenient() const { return lenient_; }
  std::vector<std::string>& warnings() { return warnings_; }

 private:
  scene::TextureLibrary& textures_;
  bool lenient_;
  std::vector<std::string>& warnings_;
  /// By description; the pointer to it is kept so that its address stays unique.
  std::unordered_map<const scene::ObjectDescription*, std::pair<scene::ObjectPointer, BsdfPointer>> built_;
  std::map<std::tuple<MicrofacetType, float, float>, std::shared_ptr<const RoughInterface>> rough_interfaces_;
  int32_t depth_ = 0;  ///< of nesting, while building
};

/// Names of all BSDF plugins, sorted.
std::vector<std::string> supported_bsdfs();

}  // namespace fogbank::transport
