// Phase functions: where a medium scatters light to.
//
// Plugins and parameters: `isotropic` (none); `hg` with `g` in (-1, 1), default 0.8: the mean cosine,
// positive for forward scattering (Henyey and Greenstein 1941, "Diffuse radiation in the galaxy", eq. 2).
//
// Directions are those in which light (or a path) travels: `incoming` before and `outgoing` after the event,
// so that going straight on has the cosine +1. Both phase functions are symmetric, so a path may be traced
// either way.
#pragma once

#include <string>
#include <vector>

#include "core/vector.h"
#include "scene/description.h"

namespace fogbank::transport {

struct PhaseSample {
  Vec3f direction{0, 0, 1};  ///< unit length, direction of travel after the event
  float pdf = 0;             ///< per solid angle; equals the phase function, so the weight is exactly 1
};

/// Henyey-Greenstein phase function; isotropic for g = 0.
class PhaseFunction {
 public:
  /// `mean_cosine`: g in (-1, 1).
  explicit PhaseFunction(float mean_cosine = 0.0f) : g_(mean_cosine) {}

  float mean_cosine() const { return g_; }
  bool is_isotropic() const { return g_ == 0.0f; }

  /// Phase function, 1/sr; integrates to 1 over the sphere. Unit directions of travel.
  float evaluate(const Vec3f& incoming, const Vec3f& outgoing) const {
    if (g_ == 0.0f) return inv_4pi;
    // 1 -+ cos is taken from the chord, because dot() has lost it where a narrow lobe (|g| near 1) peaks.
    const Vec3f chord = g_ > 0.0f ? outgoing - incoming : outgoing + incoming;
    return evaluate_offset(0.5f * glm::dot(chord, chord));
  }
  /// The same for a cosine between the directions; loses digits where |g| and |cos| are near 1, so for
  /// importances only.
  float evaluate_cosine(float cosine) const {
    return evaluate_offset(g_ >= 0.0f ? 1.0f - cosine : 1.0f + cosine);
  }
  /// Density of `sample`: the phase function itself.
  float pdf(const Vec3f& incoming, const Vec3f& outgoing) const { return evaluate(incoming, outgoing); }
  /// `u`: canonical random numbers.
  PhaseSample sample(const Vec3f& incoming, const Vec2f& u) const;

 private:
  /// `offset`: 1 - |cos| measured from the pole that the lobe points to.
  float evaluate_offset(float offset) const {
    const float a = std::fabs(g_);
    const float squared = sqr(1.0f - a) + 2.0f * a * offset;
    return inv_4pi * (1.0f - a) * (1.0f + a) / (squared * std::sqrt(squared));
  }

  float g_;
};

/// Phase function of a `<phase>` element; null stands for isotropic, as in a medium that names none.
/// Throws SceneError UNKNOWN_PHASE_FUNCTION for an unknown plugin (naming the supported ones), and whatever
/// PropertyReader throws for its parameters. With `warnings` (lenient loading) an unknown plugin becomes
/// isotropic and an unknown parameter is ignored, each with a warning.
PhaseFunction build_phase_function(const scene::ObjectPointer& description,
                                   std::vector<std::string>* warnings = nullptr);

}  // namespace fogbank::transport
