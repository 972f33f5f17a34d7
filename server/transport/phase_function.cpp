#include "transport/phase_function.h"

#include "core/frame.h"
#include "scene/text.h"

namespace fogbank::transport {

namespace {

/// Least distance of g from +-1 that a float resolves with some digits to spare.
constexpr double least_gap = 1e-5;

}  // namespace

PhaseSample PhaseFunction::sample(const Vec3f& incoming, const Vec2f& u) const {
  // The usual inversion divides by g and subtracts nearly equal numbers at both ends of its range. With
  // a = |g|, solved for 1 - cos, it becomes a product of positive factors (a = 0 gives 2 (1 - u)).
  const float a = std::fabs(g_);
  const float denominator = 1.0f - a + 2.0f * a * u.x;
  const float ratio = (1.0f - a) / denominator;
  const float offset =
      std::fmin(2.0f, 2.0f * (1.0f - u.x) * (1.0f + a * u.x) * sqr(ratio));  // 1 - cos about the lobe's pole
  const float cosine = 1.0f - offset;
  const float sine = safe_sqrt(offset * (2.0f - offset));
  const float azimuth = 2.0f * pi * u.y;
  const Frame frame = Frame::from_normal(g_ < 0.0f ? -incoming : incoming);
  PhaseSample sample;
  sample.direction =
      glm::normalize(frame.to_world({sine * std::cos(azimuth), sine * std::sin(azimuth), cosine}));
  sample.pdf = g_ == 0.0f ? inv_4pi : evaluate_offset(offset);
  return sample;
}

PhaseFunction build_phase_function(const scene::ObjectPointer& description,
                                   std::vector<std::string>* warnings) {
  if (description == nullptr) return PhaseFunction();
  scene::PropertyReader reader(*description);
  float mean_cosine = 0;
  if (description->type == "hg") {
    // The open interval (-1, 1) to float precision: at +-1 the lobe is a Dirac delta without a density.
    mean_cosine = static_cast<float>(reader.number("g", 0.8, -1.0 + least_gap, 1.0 - least_gap));
  } else if (description->type != "isotropic") {
    const std::string message =
        scene::quote(description->type) + " is not a phase function Fogbank knows; supported: hg, isotropic";
    if (warnings == nullptr)
      throw SceneError(ErrorKind::invalid_argument, "UNKNOWN_PHASE_FUNCTION", description->where, message);
    warnings->push_back(description->where.to_string() + ": " + message + "; isotropic stands in");
    return PhaseFunction();
  }
  reader.finish(warnings);
  return PhaseFunction(mean_cosine);
}

}  // namespace fogbank::transport
