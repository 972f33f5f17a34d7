#include "derivatives/medium_march.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives {

namespace {

/// Optical depth behind which a channel counts as dark: exp(-9.2) = 1e-4.
constexpr double dark_depth = 9.21;

/// Share of a channel's light that is scattered or absorbed before `distance`, out of what is before
/// `extent`.
double share_before(double sigma_t, double distance, double extent) {
  return transmittance_integral(sigma_t, distance) / transmittance_integral(sigma_t, extent);
}

}  // namespace

std::vector<double> marching_strata(const Vec3d& sigma_t, double extent, double optical_step, int steps) {
  std::vector<double> ends;
  const double longest = extent / steps;
  double begin = 0;
  while (begin < extent) {
    double densest = 0;
    bool alive = false;
    for (int c = 0; c < 3; ++c) {
      if (sigma_t[c] * begin >= dark_depth) continue;
      alive = true;
      densest = std::max(densest, sigma_t[c]);
    }
    const double step = alive ? std::min(longest, optical_step / densest) : extent;
    // A remainder by rounding is no stratum of its own.
    const double end = begin + step * (1 + 1e-9) >= extent ? extent : begin + step;
    if (!(end > begin)) break;
    ends.push_back(end);
    begin = end;
  }
  return ends;
}

std::vector<double> importance_strata(const Vec3d& sigma_t, double extent, double first, int count) {
  constexpr double growth = 3;
  std::vector<double> ends;
  const auto cumulative = [&](double distance) {
    return (share_before(sigma_t.x, distance, extent) + share_before(sigma_t.y, distance, extent) +
            share_before(sigma_t.z, distance, extent)) /
           3;
  };
  double begin = 0;
  double before = 0;
  double end = first;
  while (end > begin && end < extent) {
    const double importance = cumulative(end) - before;
    if (begin > 0 && importance > 1.0 / count) break;
    ends.push_back(end);
    begin = end;
    before += importance;
    end *= growth;
  }
  const int rest = std::max(1, static_cast<int>(std::ceil((1 - before) * count)));
  double below = begin;
  for (int k = 1; k < rest; ++k) {
    double above = extent;
    const double target = before + (1 - before) * k / rest;
    // Half of the digits will do for a boundary.
    for (int i = 0; i < 60 && above - below > 1e-8 * above; ++i) {
      const double middle = 0.5 * (below + above);
      (cumulative(middle) < target ? below : above) = middle;
    }
    if (below > begin) ends.push_back(begin = below);
  }
  ends.push_back(extent);
  return ends;
}

DistanceSample sample_stratum(const Vec3d& sigma_t, double begin, double end, double u) {
  const double length = end - begin;
  const bool grey = sigma_t.x == sigma_t.y && sigma_t.y == sigma_t.z;
  int channel = 0;
  if (!grey) {
    channel = std::min(static_cast<int>(3 * u), 2);
    u = 3 * u - channel;
  }
  const auto lost = [length](double sigma) { return -std::expm1(-sigma * length); };
  const double sigma = sigma_t[channel];
  double offset = u * length;
  if (lost(sigma) > 0) offset = std::min(-std::log1p(-u * lost(sigma)) / sigma, length);
  const auto density = [&](double s) {
    const double share = lost(s);
    return share > 0 ? s * std::exp(-s * offset) / share : 1 / length;
  };
  const double pdf =
      grey ? density(sigma) : (density(sigma_t.x) + density(sigma_t.y) + density(sigma_t.z)) / 3;
  return {begin + offset, pdf > 0 ? 1 / pdf : 0};
}

NearIntegrals near_integrals(double sigma_t, double length) {
  constexpr std::array<double, 5> nodes{0.046910077030668004, 0.230765344947158454, 0.5, 0.769234655052841546,
                                        0.953089922969331996};
  constexpr std::array<double, 5> weights{0.118463442528094544, 0.239314335249683234, 0.284444444444444444,
                                          0.239314335249683234, 0.118463442528094544};
  NearIntegrals sum;
  for (size_t i = 0; i < nodes.size(); ++i) {
    const double s = nodes[i] * length;
    const double weight = weights[i] * length * std::exp(-sigma_t * s);
    sum.order0 += weight;
    sum.order1 += weight * s;
    sum.order2 += weight * s * s;
  }
  return sum;
}

}  // namespace fogbank::derivatives
