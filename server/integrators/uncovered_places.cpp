#include "integrators/uncovered_places.h"

#include <algorithm>
#include <cmath>

namespace fogbank::integrators {

namespace {

/// As many records reach a place but for a surface between, as far as their depth bins tell: one more would
/// not see it either. Close to walls bins are too coarse; paths take the records' place there.
constexpr uint32_t most_hidden = 3;
/// Look-ups whose radiance counts less than this in the pixel aren't worth a record.
constexpr float least_importance = 1e-4f;
/// Distance that records keep from a surface ahead, in radii: on it half of the light would be missed, and
/// derivatives grow with the nearness of what they see.
constexpr float clearance_share = 0.2f;

}  // namespace

void UncoveredPlaces::look_up(const LookUp& look_up) {
  const bool on_surface = look_up.place.normal != Vec3f(0);
  if (look_up.found.weight >= least_weight) {
    if (on_surface) covered_.push_back({look_up.place, look_up.found.radius});
    return;
  }
  if (!(mean(look_up.weight) > least_importance)) return;
  if (look_up.found.rejected >= most_hidden) return;
  if (on_surface) {
    on_surfaces_.push_back(look_up.place);
    return;
  }
  const float reach = std::isfinite(look_up.reach) ? look_up.reach : default_reach_;
  cache::Wish place = look_up.place;
  const float retreat = std::fmax(clearance_share * reach - look_up.ahead, 0.0f);
  place.position -= look_up.direction * std::fmin(retreat, 0.5f * look_up.behind);
  places_.push_back({place, spacing_share * reach});
}

std::vector<cache::SpacedWish> UncoveredPlaces::places() && {
  for (const cache::Wish& wish : on_surfaces_) {
    float reach = infinity;
    for (const auto& [place, radius] : covered_)
      if (place.component == wish.component && glm::dot(place.normal, wish.normal) > cache::similar_normals)
        reach = std::fmin(reach, radius + glm::distance(place.position, wish.position));
    places_.push_back({wish, spacing_share * (std::isfinite(reach) ? reach : default_reach_)});
  }
  return std::move(places_);
}

}  // namespace fogbank::integrators
