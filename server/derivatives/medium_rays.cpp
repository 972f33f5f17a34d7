#include "derivatives/medium_rays.h"

#include <limits>

namespace fogbank::derivatives {

std::vector<MediumRay> medium_rays(const Sightlines& lines, const RayCounters& counters) {
  std::vector<MediumRay> rays(lines.size());
  for (size_t i = 0; i < rays.size(); ++i) {
    counters.poll_at(i);
    MediumRay& ray = rays[i];
    ray.direction = glm::normalize(Vec3d(lines.direction(i)));
    ray.end = lines.is_blocked(i) ? static_cast<double>(lines.distance(i))
                                  : std::numeric_limits<double>::infinity();
    ray.stretches.push_back({lines.medium(), 0, ray.end, Vec3d(0, 0, 1), Spectrum(1)});
    for (const Crossing& crossing : lines.crossings(i)) {
      MediumStretch& last = ray.stretches.back();
      // Nothing changes there.
      if (crossing.medium == last.medium && crossing.through == last.through) continue;
      last.end = static_cast<double>(crossing.distance);
      ray.stretches.push_back(
          {crossing.medium, last.end, ray.end, glm::normalize(Vec3d(crossing.normal)), crossing.through});
    }
  }
  return rays;
}

}  // namespace fogbank::derivatives
