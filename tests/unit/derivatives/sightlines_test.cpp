// Lines of sight: what they meet, and their transmittance with its derivatives against closed forms and
// finite differences of them.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/sampling.h"
#include "derivatives/sightlines.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using transport::test::parse_world;

constexpr float far_away = infinity;
constexpr std::span<const float> anywhere{&far_away, 1};

/// A cube of thin grey fog from -1 to 1 (sigma_t 0.4), in a cube of coloured smoke from -2 to 2, in vacuum,
/// with a solid wall at z = 3.
const std::string nested_cubes = R"(
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4"/><rgb name="albedo" value="0.5"/></medium>
  <medium type="homogeneous" id="smoke"><rgb name="sigma_t" value="0.9 0.1 2"/><rgb name="albedo" value="0.5"/></medium>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/><ref name="exterior" id="smoke"/></shape>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/>
    <transform name="to_world"><scale value="2"/></transform></shape>
  <shape type="rectangle"><transform name="to_world">
    <scale value="50"/><rotate x="1" angle="180"/><translate z="3"/></transform></shape>)";

/// Where a line from inside the cube from -side to side leaves it.
double exit_distance(const Vec3d& x, const Vec3d& u, double side) {
  double exit = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis)
    if (u[axis] != 0) exit = std::min(exit, (std::copysign(side, u[axis]) - x[axis]) / u[axis]);
  return exit;
}

/// Optical depth of a channel from `x` to `distance` along `u`.
double depth(const Vec3d& x, const Vec3d& u, double distance, double smoke) {
  const double inner = std::min(exit_distance(x, u, 1), distance);
  const double outer = std::min(exit_distance(x, u, 2), distance);
  return 0.4 * inner + smoke * (outer - inner);
}

/// Central differences of fourth order.
Jet3d finite_differences(const std::function<double(const Vec3d&)>& f, const Vec3d& x) {
  constexpr double h = 1e-3;
  const auto shifted = [&](int i, double a, int j, double b) {
    Vec3d y = x;
    y[i] += a * h;
    y[j] += b * h;
    return f(y);
  };
  Jet3d jet = Jet3d::constant(f(x));
  for (int i = 0; i < 3; ++i) {
    const double near = shifted(i, 1, i, 0) - shifted(i, -1, i, 0);
    const double far = shifted(i, 2, i, 0) - shifted(i, -2, i, 0);
    jet.gradient[i] = (8 * near - far) / (12 * h);
    for (int j = i; j < 3; ++j) {
      const auto mixed = [&](double s) {
        return shifted(i, s, j, s) - shifted(i, s, j, -s) - shifted(i, -s, j, s) + shifted(i, -s, j, -s);
      };
      jet.hessian(i, j) = (16 * mixed(1) - mixed(2)) / (48 * h * h);
    }
  }
  return jet;
}

/// `tolerance` is relative to the value: lengths in these scenes are about 1.
void expect_near(const Jet3d& actual, const Jet3d& expected, double tolerance) {
  EXPECT_NEAR(actual.value, expected.value, tolerance * expected.value);
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(actual.gradient[i], expected.gradient[i], tolerance * expected.value) << i;
    for (int j = i; j < 3; ++j)
      EXPECT_NEAR(actual.hessian(i, j), expected.hessian(i, j), 10 * tolerance * expected.value) << i << j;
  }
}

const double smokes[3] = {0.9, 0.1, 2.0};
/// Crossings are found in single precision, by rays from points off the exact boundary by some 1e-7.
constexpr double tolerance = 1e-5;

TEST(Sightlines, JetsThroughBoundariesAreThoseOfTheClosedForm) {
  const auto world = parse_world(nested_cubes);
  Sightlines lines(*world);
  RandomStream random(1, 0, 0, 0);
  RayCounters counters;
  int through_boundaries = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const Vec3f x = 0.9f * (2.0f * Vec3f(random.next_vec2(), random.next_float()) - Vec3f(1));
    const Vec3f u = square_to_uniform_sphere(random.next_vec2());
    // A line within 0.01 of a cube's edge has another face on the other side of a difference.
    for (const double side : {1.0, 2.0}) {
      Vec3d at = glm::abs(Vec3d(x) + exit_distance(Vec3d(x), Vec3d(u), side) * Vec3d(u));
      std::sort(&at.x, &at.x + 3);
      if (side - at.y < 0.03) goto next;
    }
    {
      lines.start(x, world->medium_at(x));
      ASSERT_EQ(lines.append({&u, 1}, anywhere, counters), 0u);
      const Vec3d relative = 0.5 * Vec3d(u) * static_cast<double>(1 + trial % 5);
      if (lines.is_blocked(0) && lines.distance(0) < glm::length(relative)) continue;
      if (glm::length(relative) < exit_distance(Vec3d(x), Vec3d(u), 2)) {
        // Ends in the smoke or before: only the crossings before the vertex count.
        const auto length = static_cast<float>(glm::length(relative));
        lines.start(x, lines.medium());
        lines.append({&u, 1}, {&length, 1}, counters);
      }
      through_boundaries += lines.crossings(0).empty() ? 0 : 1;
      const RadianceJet jet = lines.path(0).towards(relative);
      const Vec3d vertex = Vec3d(x) + relative;
      for (size_t c = 0; c < 3; ++c) {
        const auto exact = [&](const Vec3d& y) {
          const double length = glm::length(vertex - y);
          return std::exp(-depth(y, (vertex - y) / length, length, smokes[c]));
        };
        expect_near(jet.channels[c], finite_differences(exact, Vec3d(x)), tolerance);
        EXPECT_NEAR(lines.transmittance(0, static_cast<float>(glm::length(relative)))[static_cast<int>(c)],
                    jet.channels[c].value, 1e-5);
      }
    }
  next:;
  }
  EXPECT_GT(through_boundaries, 100);
}

TEST(Sightlines, DirectionHeldFixedIsLinearInDepth) {
  const auto world = parse_world(nested_cubes);
  Sightlines lines(*world);
  RandomStream random(2, 0, 0, 0);
  RayCounters counters;
  for (int trial = 0; trial < 100; ++trial) {
    const Vec3f x = 0.9f * (2.0f * Vec3f(random.next_vec2(), random.next_float()) - Vec3f(1));
    Vec3f u = square_to_uniform_sphere(random.next_vec2());
    u.z = -std::abs(u.z);  // away from the wall
    lines.start(x, world->medium_at(x));
    lines.append({&u, 1}, anywhere, counters);
    ASSERT_FALSE(lines.is_blocked(0));
    const auto crossings = lines.crossings(0);
    ASSERT_EQ(crossings.size(), 2u);
    // Closed form from the faces that the line leaves through.
    const RadianceJet jet = lines.path(0).towards_infinity(Vec3d(u));
    for (size_t c = 0; c < 3; ++c) {
      Vec3d gradient(0);
      const double differences[2] = {0.4 - smokes[c], smokes[c]};
      for (size_t k = 0; k < 2; ++k)
        gradient -=
            differences[k] * Vec3d(crossings[k].normal) / glm::dot(Vec3d(crossings[k].normal), Vec3d(u));
      const double value = std::exp(-depth(Vec3d(x), Vec3d(u), 1e9, smokes[c]));
      const Jet3d expected{value, -value * gradient, value * Symmetric3d::outer(gradient)};
      // Grazing lines have gradients of 1 / cosine.
      const double steep = 1 + glm::dot(gradient, gradient);
      expect_near(jet.channels[c], expected, 1e-5 * steep);
      EXPECT_NEAR(lines.transmittance(0, infinity)[static_cast<int>(c)], value, 1e-5);
    }
  }
}

TEST(Sightlines, OneMediumIsExact) {
  const auto world = parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5"/>
    <rgb name="albedo" value="0.5"/></medium><sensor type="perspective"><ref id="fog"/></sensor>
    <shape type="sphere"><float name="radius" value="3"/></shape>)");
  Sightlines lines(*world);
  RayCounters counters;
  lines.start({0.5f, 0, 0}, 0);
  const std::vector<Vec3f> directions{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}};
  lines.append(directions, anywhere, counters);
  EXPECT_EQ(counters.closest_hit, 3u);
  EXPECT_NEAR(lines.distance(0), 2.5f, 1e-6f);
  EXPECT_NEAR(lines.distance(1), 3.5f, 1e-6f);
  EXPECT_TRUE(lines.crossings(0).empty());
  EXPECT_EQ(lines.last_medium(2), 0);
  EXPECT_NEAR(lines.surface(1).position.x, -3, 1e-6);
  const RadianceJet jet = lines.path(0).towards({2.5, 0, 0});
  EXPECT_TRUE(lines.path(0).uniform());
  const double t = std::exp(-1.25);
  EXPECT_DOUBLE_EQ(jet.channels[2].value, t);
  EXPECT_DOUBLE_EQ(jet.channels[0].gradient.x, 0.5 * t);
  EXPECT_DOUBLE_EQ(jet.channels[0].hessian(0, 0), 0.25 * t);
  EXPECT_DOUBLE_EQ(jet.channels[0].hessian(1, 1), -0.5 / 2.5 * t);
}

/// A pane that lets 0.25 through (and reflects 0.75) before a wall.
TEST(Sightlines, StopsKeepTheMean) {
  const auto world =
      parse_world(R"(<shape type="rectangle"><bsdf type="mask"><float name="opacity" value="0.75"/>
      <bsdf type="diffuse"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><translate z="-1"/></transform></shape>)");
  Sightlines lines(*world);
  RayCounters counters;
  RandomStream stops(3, 0, 0, 0);
  const std::vector<Vec3f> directions(4000, Vec3f(0, 0, -1));
  lines.start({0.1f, 0.2f, 1}, scene::none);
  lines.append(directions, anywhere, counters);
  EXPECT_EQ(lines.distance(7), 2.0f);
  EXPECT_EQ(lines.transmittance(7, 2)[0], 0.25f);
  lines.start({0.1f, 0.2f, 1}, scene::none);
  lines.append(directions, anywhere, counters, &stops);
  double pane = 0;
  double wall = 0;
  for (size_t i = 0; i < lines.size(); ++i) (lines.distance(i) < 1.5f ? pane : wall) += lines.factor(i)[1];
  // Weighted shares: all of what leaves the pane, 0.25 of what leaves the wall; 5 standard deviations.
  EXPECT_NEAR(pane / 4000, 1, 5 * std::sqrt(0.25 / 0.75 / 4000));
  EXPECT_NEAR(wall / 4000, 0.25, 5 * std::sqrt(0.25 * 0.75 / 4000));
}

TEST(Sightlines, BundledVisibilityIsThatOfTheWorld) {
  const auto world =
      parse_world(nested_cubes + R"(<shape type="sphere"><point name="center" x="0.5" y="0" z="1.5"/>
    <float name="radius" value="0.4"/></shape>)");
  RandomStream random(4, 0, 0, 0);
  const Vec3f x(0.1f, -0.2f, 0.3f);
  std::vector<Vec3d> relative;
  for (int i = 0; i < 500; ++i)
    relative.push_back(Vec3d(square_to_uniform_sphere(random.next_vec2())) *
                       static_cast<double>(0.1f + 4 * random.next_float()));
  std::vector<Spectrum> bundled(relative.size());
  RayCounters counters;
  visibility(*world, x, world->medium_at(x), relative, bundled, counters);
  RayCounters one_by_one;
  for (size_t i = 0; i < relative.size(); ++i) {
    const double length = glm::length(relative[i]);
    const Spectrum expected = world->visibility(x, Vec3f(relative[i] / length), static_cast<float>(length),
                                                world->medium_at(x), one_by_one);
    EXPECT_EQ(bundled[i], expected) << i;
  }
  EXPECT_EQ(counters.total(), one_by_one.total());
}

}  // namespace
}  // namespace fogbank::derivatives
