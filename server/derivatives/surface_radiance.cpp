#include "derivatives/surface_radiance.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

std::vector<int32_t> share_out(const transport::World& world, std::span<const SurfaceHit> hits,
                               int32_t budget) {
  std::vector<double> weights(hits.size(), 0);
  std::vector<int32_t> counts(hits.size(), 0);
  double total = 0;
  int32_t left = budget;
  for (size_t i = 0; i < hits.size(); ++i) {
    if (!(hits[i].importance > 0)) continue;
    const Spectrum albedo = world.bsdf(hits[i].surface.shape).albedo_estimate();
    weights[i] = static_cast<double>(hits[i].importance * std::max(luminance(albedo), 0.0f));
    total += weights[i];
    // The estimate of the reflectance is no more than that, so nothing that counts goes without a sample.
    counts[i] = 1;
    --left;
  }
  if (left <= 0 || !(total > 0) || !std::isfinite(total)) return counts;
  double due = 0.5;
  for (size_t i = 0; i < hits.size(); ++i) {
    due += weights[i] / total * left;
    const double whole = std::floor(due);
    counts[i] += static_cast<int32_t>(whole);
    due -= whole;
  }
  return counts;
}

std::vector<Spectrum> surface_radiance(const transport::World& world, const SurfaceSource& source,
                                       std::span<const SurfaceHit> hits, int32_t budget, RandomStream& random,
                                       RayCounters& counters) {
  const std::vector<int32_t> counts = share_out(world, hits, budget);
  std::vector<Spectrum> radiance(hits.size(), Spectrum(0));
  for (size_t i = 0; i < hits.size(); ++i)
    if (counts[i] > 0) radiance[i] = source.leaving_radiance(hits[i], counts[i], random, counters);
  return radiance;
}

std::vector<Spectrum> filter_over_neighbours(std::span<const Spectrum> radiance,
                                             const GridNeighbours& neighbours,
                                             std::span<const uint32_t> surfaces) {
  std::vector<Spectrum> filtered(radiance.size());
  for (size_t i = 0; i < radiance.size(); ++i) {
    Spectrum sum = radiance[i];
    for (const uint32_t j : neighbours[i]) sum += radiance[surfaces[j] == surfaces[i] ? j : i];
    filtered[i] = sum / 9.0f;
  }
  return filtered;
}

}  // namespace fogbank::derivatives
