#include "derivatives/delta_lights.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "derivatives/sightlines.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

namespace {

constexpr double inverse_4pi = std::numbers::inv_pi / 4;

/// Share of the peak intensity that a spot light sends along `from_light`, as x moves.
Jet3d falloff(const transport::PointShape& light, const Vec3d& r, const Jet3d& inverse_distance) {
  const Vec3d axis = glm::normalize(Vec3d(light.axis));
  const Jet3d cosine = Jet3d::linear(-glm::dot(r, axis), axis) * inverse_distance;
  const double angle = std::acos(std::clamp(cosine.value, -1.0, 1.0));
  const double beam = light.beam_width;
  const double cutoff = light.cutoff_angle;
  if (angle <= beam) return Jet3d::constant(1);
  const double sine = std::sqrt(std::max(1 - cosine.value * cosine.value, 0.0));
  if (angle >= cutoff || !(sine > 0)) return {};
  const double slope = -1 / (cutoff - beam);
  // d acos(c) = -dc / sin, d^2 acos(c) = -c dc^2 / sin^3.
  return chain(cosine, (cutoff - angle) / (cutoff - beam), -slope / sine,
               -slope * cosine.value / (sine * sine * sine));
}

void add_weighted(const Jet3d& field, const RadianceJet& transmittance, const Spectrum& weight,
                  RadianceJet& sum) {
  for (size_t c = 0; c < 3; ++c)
    sum.channels[c] += (field * transmittance.channels[c]) *
                       (inverse_4pi * static_cast<double>(weight[static_cast<int>(c)]));
}

}  // namespace

DeltaLights::DeltaLights(const transport::World& world, const transport::Plan& plan, double least_distance)
    : world_(world), least_distance_(least_distance) {
  for (uint32_t i = 0; i < world.lights().size(); ++i) {
    if (plan.treatment(i) != transport::LightTreatment::closed_form) continue;
    const transport::LightShape shape = world.lights().light(i).shape();
    if (const auto* point = std::get_if<transport::PointShape>(&shape)) points_.push_back(*point);
    if (const auto* light = std::get_if<transport::DirectionalShape>(&shape)) directional_.push_back(*light);
  }
}

void DeltaLights::add(const Vec3f& x, int32_t medium, RadianceJet& sum, RayCounters& counters) const {
  if (size() == 0) return;
  std::vector<Vec3d> targets;
  for (const transport::PointShape& light : points_) {
    const Vec3d r = Vec3d(light.position) - Vec3d(x);
    const double distance = glm::length(r);
    if (distance >= least_distance_) {
      targets.push_back(r);
    } else {
      targets.push_back(distance > 0 ? r * (least_distance_ / distance) : Vec3d(0, 0, least_distance_));
    }
  }
  std::vector<Vec3f> directions;
  for (const transport::DirectionalShape& light : directional_) directions.push_back(-light.direction);
  Sightlines lines(world_);
  lines.start(x, medium);
  lines.append_to_points(targets, counters);
  constexpr std::array<float, 1> no_limit{infinity};
  lines.append(directions, no_limit, counters);

  for (size_t i = 0; i < points_.size(); ++i) {
    if (lines.is_blocked(i)) continue;
    const Jet3d distance = distance_jet(targets[i]);
    const double inverse = 1 / distance.value;
    const Jet3d inverse_distance =
        chain(distance, inverse, -inverse * inverse, 2 * inverse * inverse * inverse);
    const Jet3d share = falloff(points_[i], targets[i], inverse_distance);
    add_weighted(inverse_distance * inverse_distance * share, lines.path(i).towards(targets[i]),
                 points_[i].intensity, sum);
  }
  for (size_t i = 0; i < directional_.size(); ++i) {
    const size_t line = points_.size() + i;
    if (!lines.is_blocked(line))
      add_weighted(Jet3d::constant(1), lines.path(line).towards_infinity(Vec3d(directions[i])),
                   directional_[i].irradiance, sum);
  }
}

}  // namespace fogbank::derivatives
