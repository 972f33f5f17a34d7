#include "integrators/medium_records.h"

#include <cmath>

#include "cache/directional_shape.h"

namespace fogbank::integrators {

namespace {

/// Two decimals are what scene files say.
std::string text_of(float number) {
  std::string text = std::to_string(std::round(number * 100) / 100);
  text.resize(text.size() - 4);
  return text;
}

bool is_narrow(const transport::PhaseFunction& phase) {
  return std::fabs(phase.mean_cosine()) > cache::most_mean_cosine;
}

}  // namespace

std::optional<cache::Quantity> CacheTechnique::rest(const transport::MediumInfo& medium) const {
  if (is_black(medium.sigma_s)) return std::nullopt;
  if (medium.phase.is_isotropic()) return aware ? cache::Quantity::rest : cache::Quantity::unaware_rest;
  return aware && !is_narrow(medium.phase) ? std::optional(cache::Quantity::directional_rest) : std::nullopt;
}

std::optional<cache::Quantity> CacheTechnique::direct(const transport::MediumInfo& medium) const {
  return !aware && rest(medium) ? std::optional(cache::Quantity::unaware_direct) : std::nullopt;
}

std::vector<Decision> medium_decisions(const transport::World& world, const CacheTechnique& technique) {
  std::vector<Decision> decisions;
  for (size_t number = 0; number < world.scene().media.size(); ++number) {
    const transport::MediumInfo& medium = world.medium(static_cast<int32_t>(number));
    if (medium.phase.is_isotropic() || is_black(medium.sigma_s)) continue;
    const std::string& id = world.scene().media[number].id;
    Decision& decision = decisions.emplace_back();
    decision.what = "records in medium " + (id.empty() ? std::to_string(number) : '"' + id + '"');
    decision.on = technique.rest(medium).has_value();
    const std::string lobe = "its phase function has a mean cosine of " + text_of(medium.phase.mean_cosine());
    if (decision.on) {
      decision.reason = lobe + ": they hold how light is spread over directions, up to degree " +
                        std::to_string(harmonic_degrees);
    } else if (technique.aware) {
      decision.reason =
          lobe + ", too narrow for what records hold (at most " + text_of(cache::most_mean_cosine) + ")";
    } else {
      decision.reason = lobe + ", and this method's records hold nothing but the mean over directions";
    }
  }
  return decisions;
}

}  // namespace fogbank::integrators
