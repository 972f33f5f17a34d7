#include "cache/packed_normal.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cstring>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank::cache {
namespace {

bool same_bits(const Vec3f& a, const Vec3f& b) {
  using Bits = std::array<uint32_t, 3>;
  return std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b);
}

void expect_stable(uint32_t packed) {
  const Vec3f normal = unpack_normal(packed);
  EXPECT_TRUE(same_bits(normal, unpack_normal(pack_normal(normal)))) << packed;
}

TEST(PackedNormal, IsClose) {
  RandomStream random(1, 0, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f normal = square_to_uniform_sphere(random.next_vec2());
    // Half a step of 1/32767 in both coordinates, stretched at most sqrt(3)-fold by the map.
    EXPECT_LT(glm::distance(unpack_normal(pack_normal(normal)), normal), 7e-5f);
  }
}

TEST(PackedNormal, AxesAndZeroAreExact) {
  EXPECT_EQ(unpack_normal(pack_normal(Vec3f(0))), Vec3f(0));
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {-1.0f, 1.0f}) {
      Vec3f normal(0);
      normal[axis] = sign;
      EXPECT_EQ(unpack_normal(pack_normal(normal)), normal);
    }
}

TEST(PackedNormal, SurvivesAnotherRound) {
  // The map's border, where two points stand for each direction, the fold and the axes; then anywhere.
  for (uint32_t along = 0; along <= 65534; ++along) {
    for (const uint32_t across : {0u, 1u, 32766u, 32767u, 32768u, 65533u, 65534u}) {
      expect_stable(along | across << 16);
      expect_stable(across | along << 16);
    }
    const uint32_t fold = along <= 32767 ? 32767 - along : along - 32767;
    for (const uint32_t across : {fold, 65534 - fold}) expect_stable(along | across << 16);
  }
  RandomStream random(2, 0, 0, 0);
  for (int i = 0; i < 100000; ++i) expect_stable(pack_normal(square_to_uniform_sphere(random.next_vec2())));
}

}  // namespace
}  // namespace fogbank::cache
