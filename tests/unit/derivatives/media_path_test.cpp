// Transmittance through media one behind the other, where planes are met at all angles.
#include "derivatives/media_path.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::derivatives {
namespace {

TEST(MediaPath, NeverAmplifies) {
  RandomStream random(1, 0, 0, 0);
  for (int i = 0; i < 20000; ++i) {
    // The boundary that was traced, and a target elsewhere: planes may be met before the start, behind the
    // target, or not at all.
    MediaPath path;
    path.sigma_t = Spectrum(20 * random.next_float());
    for (int boundary = 0; boundary < 2; ++boundary)
      path.boundaries.push_back(
          {Vec3d(square_to_uniform_sphere(random.next_vec2())) * static_cast<double>(random.next_float()),
           Vec3d(square_to_uniform_sphere(random.next_vec2())), Spectrum(20 * random.next_float())});
    const Vec3d direction(square_to_uniform_sphere(random.next_vec2()));
    for (const RadianceJet& jet : {path.towards(direction * static_cast<double>(0.01f + random.next_float())),
                                   path.towards_infinity(direction)}) {
      const Jet3d& channel = jet.channels[0];
      EXPECT_GE(channel.value, 0);
      EXPECT_LE(channel.value, 1);
      // Of exp(-depth): sigma over the least cosine, which is held at 1e-3, squared.
      EXPECT_LE(glm::length(channel.gradient), 1e8);
      EXPECT_TRUE(std::isfinite(channel.hessian.norm()));
    }
  }
}

TEST(MediaPath, BoundariesInOrderCountInFull) {
  // 1 of sigma 2, 2 of sigma 0.5, 3 of sigma 1, met at right angles.
  MediaPath path;
  path.sigma_t = Spectrum(2);
  path.boundaries.push_back({Vec3d(0, 0, 1), Vec3d(0, 0, 1), Spectrum(0.5f)});
  path.boundaries.push_back({Vec3d(0, 0, 3), Vec3d(0, 0, 1), Spectrum(1)});
  const Jet3d jet = path.towards({0, 0, 6}).channels[1];
  const double expected = std::exp(-(2.0 + 1.0 + 3.0));
  EXPECT_NEAR(jet.value, expected, 1e-12 * expected);
  // Nearer by dz: that much less of the first medium.
  EXPECT_NEAR(jet.gradient.z, 2 * expected, 1e-12 * expected);
}

}  // namespace
}  // namespace fogbank::derivatives
