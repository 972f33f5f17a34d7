// The plan of a scene: which terms of light transport its records need, which are left out, and why. A scene
// pays only for what it contains.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "transport/light_obstacles.h"
#include "transport/world.h"

namespace fogbank::transport {

/// What a record is to hold; a plan is made for one such wish.
struct PlanRequest {
  bool from_surfaces = true;  ///< light whose last stretch begins on a surface, emitter or environment
  bool from_medium = true;    ///< light whose last stretch begins in the medium
  int32_t max_depth = -1;     ///< edges of a whole path, as IntegratorSettings; -1: unbounded
  bool leave_out = true;  ///< false: every term is on, needed or not; for measuring what leaving out saves
};

/// One line of `fogbank plan`.
struct PlanTerm {
  std::string term;    ///< e.g. "sphere grid"
  bool on = false;     ///< computed
  std::string reason;  ///< a sentence without its full stop, e.g. "no surface reflects light"
};

/// How the light of one emitter gets into a record.
enum class LightTreatment : uint8_t {
  left_out,          ///< it sends nothing, or nothing of it is asked for
  closed_form,       ///< delta lights
  light_grid,        ///< a grid of its own over an emitter at a finite place
  environment_grid,  ///< image environments: cells by importance
  sphere_grid        ///< constant environments: the record's own sphere of directions
};

/// Immutable. Derived from a world in time linear in its shapes, plus lights times triangles where a scene
/// has at most LightObstacles::most_triangles of them.
class Plan {
 public:
  Plan(const World& world, const PlanRequest& request);

  /// Does any consumer of the sphere of directions exist: reflected light, mirrors, a constant environment,
  /// or light from the medium?
  bool sphere_grid() const { return reflected_ || mirrors_ || constant_environment_ || shells_; }
  /// Light that surfaces reflect by lobes other than delta ones.
  bool reflected() const { return reflected_; }
  /// Surfaces with delta lobes show lights by reflection or refraction.
  bool mirrors() const { return mirrors_; }
  bool constant_environment() const { return constant_environment_; }
  /// Light from the medium: multiple scattering.
  bool shells() const { return shells_; }
  /// Some medium's extinction differs between channels: one transmittance each; otherwise one serves all.
  bool chromatic() const { return chromatic_; }
  LightTreatment treatment(uint32_t light) const { return treatments_[light]; }
  /// Can silhouettes cut into this light as seen from x? If not, no bisection and no shadow ray.
  bool may_be_occluded(uint32_t light, const Vec3f& x) const {
    return force_ || occluders_[light].possible(x);
  }
  /// Can surfaces that light passes lie between? If not, one exponential is the transmittance.
  bool may_cross_boundaries(uint32_t light, const Vec3f& x) const {
    return force_ || passing_[light].possible(x);
  }

  /// All terms, on and off, in the order in which a record is computed.
  const std::vector<PlanTerm>& terms() const { return terms_; }

 private:
  void describe_obstacles();

  bool force_ = false;
  bool reflected_ = false;
  bool mirrors_ = false;
  bool constant_environment_ = false;
  bool shells_ = false;
  bool chromatic_ = false;
  std::vector<LightTreatment> treatments_;
  std::vector<LightObstacles> occluders_;
  std::vector<LightObstacles> passing_;
  std::vector<PlanTerm> terms_;
};

}  // namespace fogbank::transport
