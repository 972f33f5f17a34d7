#include "derivatives/media_path.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

namespace {

/// exp(-depth) with surfaces; `depth_of(channel)` is an optical depth as a jet.
template <typename DepthOf>
RadianceJet transmittance_of(const MediaPath& path, const DepthOf& depth_of) {
  RadianceJet result;
  const Spectrum& s = path.sigma_t;
  bool grey = s.x == s.y && s.y == s.z;
  for (const MediaPath::Boundary& boundary : path.boundaries)
    grey = grey && boundary.sigma_t.x == boundary.sigma_t.y && boundary.sigma_t.y == boundary.sigma_t.z;
  Jet3d last;
  for (int c = 0; c < 3; ++c) {
    if (c == 0 || !grey) last = transmittance_jet(1.0, depth_of(c));
    result.channels[static_cast<size_t>(c)] = last * static_cast<double>(path.surfaces[c]);
  }
  return result;
}

/// A boundary met at a grazing angle counts as met at this cosine: derivatives grow as its inverse square.
constexpr double least_cosine = 1e-3;

/// n . r with r of the given length, held off zero.
double not_grazing(double along, double length) {
  return std::copysign(std::max(std::abs(along), least_cosine * length), along);
}

/// Boundaries are crossed one after the other on the way. Where planes say otherwise, close to grazing angles
/// or far from the line that was traced, the crossing stays put: optical depths would be negative.
Jet3d in_order(const Jet3d& crossing, double last, double end) {
  if (crossing.value >= last && crossing.value <= end) return crossing;
  return Jet3d::constant(std::clamp(crossing.value, last, end));
}

/// Adds (sigma before - sigma beyond) times the distance to each boundary; `distance_to(boundary)` as a jet,
/// at most `end`.
template <typename DistanceTo>
void add_boundaries(const MediaPath& path, int channel, double end, Jet3d& depth,
                    const DistanceTo& distance_to) {
  double before = path.sigma_t[channel];
  double last = 0;
  for (const MediaPath::Boundary& boundary : path.boundaries) {
    const double beyond = boundary.sigma_t[channel];
    const Jet3d distance = in_order(distance_to(boundary), last, end);
    depth += distance * (before - beyond);
    before = beyond;
    last = distance.value;
  }
}

}  // namespace

RadianceJet MediaPath::towards(const Vec3d& r) const {
  const Jet3d distance = distance_jet(r);
  return transmittance_of(*this, [&](int c) {
    const double last = boundaries.empty() ? sigma_t[c] : boundaries.back().sigma_t[c];
    Jet3d depth = distance * last;
    add_boundaries(*this, c, distance.value, depth, [&](const Boundary& boundary) {
      // distance * n.b / n.r, all of them moving with x.
      const Jet3d reach = Jet3d::linear(glm::dot(boundary.normal, boundary.position), -boundary.normal);
      const double along = not_grazing(glm::dot(boundary.normal, r), distance.value);
      const double inverse = along != 0 ? 1 / along : 0;
      const Jet3d reciprocal = chain(Jet3d::linear(along, -boundary.normal), inverse, -inverse * inverse,
                                     2 * inverse * inverse * inverse);
      return distance * (reach * reciprocal);
    });
    return depth;
  });
}

RadianceJet MediaPath::towards_infinity(const Vec3d& direction) const {
  const Spectrum& last = boundaries.empty() ? sigma_t : boundaries.back().sigma_t;
  RadianceJet result = transmittance_of(*this, [&](int c) {
    Jet3d depth;
    add_boundaries(*this, c, std::numeric_limits<double>::infinity(), depth, [&](const Boundary& boundary) {
      const double inverse = 1 / not_grazing(glm::dot(boundary.normal, direction), 1);
      return Jet3d::linear(glm::dot(boundary.normal, boundary.position) * inverse,
                           -boundary.normal * inverse);
    });
    return depth;
  });
  for (int c = 0; c < 3; ++c) {
    if (last[c] > 0) result.channels[static_cast<size_t>(c)] = {};
  }
  return result;
}

}  // namespace fogbank::derivatives
