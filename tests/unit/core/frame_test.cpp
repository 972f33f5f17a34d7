#include "core/frame.h"

#include <gtest/gtest.h>

#include "core/random.h"
#include "core/sampling.h"

namespace fogbank {
namespace {

// Duff et al. 2017 report a worst error of 2.7e-7 of the basis in single precision; the normals here are
// themselves off unit length by up to 2e-7.
constexpr float tolerance = 1e-6f;

void expect_orthonormal(const Frame& frame) {
  ASSERT_NEAR(glm::length(frame.tangent), 1.0f, tolerance);
  ASSERT_NEAR(glm::length(frame.bitangent), 1.0f, tolerance);
  ASSERT_NEAR(glm::length(frame.normal), 1.0f, tolerance);
  ASSERT_NEAR(glm::dot(frame.tangent, frame.bitangent), 0.0f, tolerance);
  ASSERT_NEAR(glm::dot(frame.tangent, frame.normal), 0.0f, tolerance);
  ASSERT_NEAR(glm::dot(frame.bitangent, frame.normal), 0.0f, tolerance);
  const Vec3f third = glm::cross(frame.tangent, frame.bitangent);
  ASSERT_NEAR(glm::distance(third, frame.normal), 0.0f, 4 * tolerance) << "not right-handed";
}

TEST(Frame, IsOrthonormalForAMillionNormals) {
  RandomStream random(1, 0, 0, 0);
  for (int i = 0; i < 1000000; ++i) {
    expect_orthonormal(Frame::from_normal(square_to_uniform_sphere(random.next_vec2())));
    if (HasFatalFailure()) return;
  }
}

TEST(Frame, IsOrthonormalAroundThePoles) {
  // The construction divides by sign(z) + z: both poles, both zeros, and what lies next to them.
  const float tiny = 1e-20f;
  for (const float z : {1.0f, -1.0f}) {
    expect_orthonormal(Frame::from_normal({0, 0, z}));
    expect_orthonormal(Frame::from_normal({tiny, -tiny, z}));
    expect_orthonormal(Frame::from_normal(glm::normalize(Vec3f{1e-4f, 1e-4f, z})));
  }
  for (const float z : {0.0f, -0.0f, tiny, -tiny}) {
    expect_orthonormal(Frame::from_normal({1, 0, z}));
    expect_orthonormal(Frame::from_normal({0, -1, z}));
  }
}

TEST(Frame, TangentFollowsTheGivenDirection) {
  RandomStream random(2, 0, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const Vec3f normal = square_to_uniform_sphere(random.next_vec2());
    const Vec3f dp_du = 100.0f * square_to_uniform_sphere(random.next_vec2());
    const Frame frame = Frame::from_normal_and_tangent(normal, dp_du);
    // Subtracting the normal's share of a tangent nearly along it loses digits: by 1 / sin of their angle.
    const float sine = glm::length(glm::cross(normal, dp_du)) / 100.0f;
    ASSERT_NEAR(glm::dot(frame.tangent, frame.normal), 0.0f, tolerance / sine);
    ASSERT_GE(glm::dot(frame.tangent, dp_du), 0.0f);
    ASSERT_NEAR(glm::dot(frame.bitangent, dp_du) / 100.0f, 0.0f, tolerance / sine);
  }
}

TEST(Frame, FallsBackWhereTheTangentIsUseless) {
  const Vec3f normal = glm::normalize(Vec3f{1, 2, 3});
  expect_orthonormal(Frame::from_normal_and_tangent(normal, Vec3f(0)));
  expect_orthonormal(Frame::from_normal_and_tangent({0, 0, 1}, {0, 0, 5}));
  expect_orthonormal(Frame::from_normal_and_tangent(normal, Vec3f(std::numeric_limits<float>::quiet_NaN())));
}

TEST(Frame, LocalAndWorldAreInverse) {
  RandomStream random(3, 0, 0, 0);
  for (int i = 0; i < 100000; ++i) {
    const Frame frame = Frame::from_normal(square_to_uniform_sphere(random.next_vec2()));
    const Vec3f v = square_to_uniform_sphere(random.next_vec2());
    ASSERT_NEAR(glm::distance(frame.to_world(frame.to_local(v)), v), 0.0f, 4 * tolerance);
    ASSERT_NEAR(glm::distance(frame.to_local(frame.normal), Vec3f(0, 0, 1)), 0.0f, 4 * tolerance);
  }
}

}  // namespace
}  // namespace fogbank
