#include "cache/neighbour_clamp.h"

#include <gtest/gtest.h>

#include "cache/record_set.h"
#include "record_clouds.h"

namespace fogbank::cache {
namespace {

std::vector<Vec3f> positions_of(const RecordSet& set) {
  std::vector<Vec3f> result;
  for (uint32_t i = 0; i < set.components()[0].place_count; ++i)
    result.push_back(set.place(set.components()[0], i).position);
  return result;
}

std::vector<float> brute_force(const std::vector<Vec3f>& positions, const std::vector<float>& radii) {
  std::vector<float> result = radii;
  for (size_t i = 0; i < radii.size(); ++i) {
    for (size_t j = 0; j < radii.size(); ++j) {
      const Vec3f offset = positions[j] - positions[i];
      const float distance = std::sqrt(offset.x * offset.x + offset.y * offset.y + offset.z * offset.z);
      result[i] = std::min(result[i], radii[j] + distance);
    }
  }
  return result;
}

class NeighbourClamp : public testing::TestWithParam<size_t> {};

TEST_P(NeighbourClamp, IsTheMinimumOverAllPairsToTheBit) {
  const RecordSet set(test::make_cloud(test::Layout::sheets, GetParam(), 12, 3));
  const std::vector<Vec3f> positions = positions_of(set);
  const std::span<const PositionPacket> packets = set.positions(set.components()[0]);
  RandomStream random(1, 0, 0, 0);
  std::vector<float> smooth;
  std::vector<float> rough;
  std::vector<float> zero_somewhere;
  for (const Vec3f& position : positions) {
    smooth.push_back(0.1f + 0.05f * std::sin(9 * position.x));
    rough.push_back(std::exp(-8 * random.next_float()));
    zero_somewhere.push_back(random.next_float() < 0.01f ? 0.0f : 1.0f);
  }
  for (const std::vector<float>& radii : {smooth, rough, zero_somewhere})
    EXPECT_EQ(neighbour_clamp(packets, radii), brute_force(positions, radii));
}

INSTANTIATE_TEST_SUITE_P(Sizes, NeighbourClamp, testing::Values(1, 2, 7, 8, 9, 64, 65, 3000));

TEST(NeighbourClamp, OnePassIsTheFixedPoint) {
  const RecordSet set(test::make_cloud(test::Layout::uniform, 500, 12, 4));
  const std::span<const PositionPacket> packets = set.positions(set.components()[0]);
  RandomStream random(2, 0, 0, 0);
  std::vector<float> radii(500);
  for (float& radius : radii) radius = std::exp(-6 * random.next_float());
  const std::vector<float> once = neighbour_clamp(packets, radii);
  const std::vector<float> twice = neighbour_clamp(packets, once);
  // The triangle inequality holds to a rounding of each distance.
  for (size_t i = 0; i < once.size(); ++i) EXPECT_NEAR(twice[i], once[i], 3e-7f);
}

}  // namespace
}  // namespace fogbank::cache
