#include "derivatives/irradiance_noise.h"

namespace fogbank::derivatives {

double variance_of_mean(std::span<const Spectrum> radiance) {
  double sum = 0;
  for (size_t i = 0; i + 1 < radiance.size(); i += 2) {
    const auto difference = static_cast<double>(luminance(radiance[i] - radiance[i + 1]));
    sum += difference * difference;
  }
  const auto count = static_cast<double>(radiance.size());
  return sum / (count * count);
}

double variance_of_sum(const HemisphereGrid& grid, std::span<const uint32_t> surfaces,
                       std::span<const Spectrum> radiance, std::span<const Vec3f> shares) {
  double sum = 0;
  for (uint32_t cell = 0; cell < radiance.size(); ++cell) {
    double spread = 0;
    double count = 0;
    for (const uint32_t other : grid.neighbours()[cell]) {
      if (other == cell || surfaces[other] != surfaces[cell]) continue;
      const auto difference = static_cast<double>(luminance(radiance[other] - radiance[cell]));
      spread += difference * difference / 2;
      ++count;
    }
    const Vec3d share(shares[cell]);
    if (count > 0) sum += spread / count * glm::dot(share, share);
  }
  return sum;
}

}  // namespace fogbank::derivatives
