// Direct light of every kind of light against quadrature over exactly what is seen of it, and finite
// differences: in the open, behind a blocker, through the end of a medium.
#include "derivatives/light_gather.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "core/random.h"
#include "derivatives/light_references.h"
#include "derivatives/plan_request.h"
#include "derivatives/text_scene.h"

namespace fogbank::derivatives {
namespace {

std::shared_ptr<const transport::World> world_of(double sigma_t, const std::string& body) {
  return test::world_in_fog(std::to_string(sigma_t), "0.5", body);
}

const std::string emitter = "<emitter type=\"area\"><float name=\"radiance\" value=\"1\"/></emitter>";

constexpr double edge = -0.05;
/// z = 1, y > edge; far wider than any light is seen.
const std::string half_plane =
    "<shape type=\"rectangle\"><transform name=\"to_world\"><scale value=\"20\"/><translate y=\"19.95\" "
    "z=\"1\"/></transform></shape>";

RadianceJet direct_light(const transport::World& world, const EstimatorSettings& settings, const Vec3f& x,
                         uint32_t repeats = 1) {
  const transport::Plan plan(world, plan_request(settings));
  const LightGather gather(world, plan, settings);
  const int32_t medium = world.medium_at(x);
  RadianceJet sum;
  RayCounters counters;
  for (uint32_t i = 0; i < repeats; ++i) {
    RandomStream random(3, i, 0, 0);
    gather.add(x, medium, random, sum, counters);
  }
  sum *= 1.0 / repeats;
  return sum;
}

struct Case {
  std::string name;
  std::string shape;
  std::function<double(const test::LightReferences&, const Vec3d&)> value;
};

double cube_value(const test::LightReferences& reference, const Vec3d& x) {
  const Vec3d c(0.125, 0, 2.25);
  constexpr double half = 0.375;
  double sum = 0;
  for (int axis = 0; axis < 3; ++axis) {
    for (const double side : {-half, half}) {
      Vec3d n(0);
      Vec3d u(0);
      Vec3d v(0);
      n[axis] = side;
      u[(axis + 1) % 3] = half;
      v[(axis + 2) % 3] = side;
      sum += reference.polygon({c + n - u - v, c + n + u - v, c + n + u + v, c + n - u + v}, x);
    }
  }
  return sum;
}

std::vector<Case> cases() {
  const auto shape = [](const std::string& type, const std::string& inside) {
    return "<shape type=\"" + type + "\">" + inside + emitter + "</shape>";
  };
  return {
      {"rectangle",
       shape("rectangle",
             "<transform name=\"to_world\"><rotate x=\"1\" angle=\"180\"/><scale x=\"0.625\" y=\"0.375\" "
             "z=\"1\"/><translate z=\"2\"/></transform>"),
       [](const test::LightReferences& reference, const Vec3d& x) {
         return reference.polygon(
             {{-0.625, -0.375, 2}, {-0.625, 0.375, 2}, {0.625, 0.375, 2}, {0.625, -0.375, 2}}, x);
       }},
      {"disk",
       shape("disk",
             "<transform name=\"to_world\"><rotate x=\"1\" angle=\"180\"/><scale value=\"0.625\"/><translate "
             "z=\"2\"/></transform>"),
       [](const test::LightReferences& reference, const Vec3d& x) {
         return reference.disk({0, 0, 2}, 0.625, x);
       }},
      {"sphere",
       shape("sphere",
             "<point name=\"center\" x=\"0\" y=\"0\" z=\"2.25\"/><float name=\"radius\" value=\"0.5\"/>"),
       [](const test::LightReferences& reference, const Vec3d& x) {
         return reference.sphere({0, 0, 2.25}, 0.5, x);
       }},
      {"cylinder",
       shape("cylinder",
             "<point name=\"p0\" x=\"-0.75\" y=\"0\" z=\"2.25\"/><point name=\"p1\" x=\"0.75\" y=\"0\" "
             "z=\"2.25\"/><float name=\"radius\" value=\"0.5\"/>"),
       [](const test::LightReferences& reference, const Vec3d& x) {
         return reference.cylinder(0.75, 2.25, 0.5, x);
       }},
      {"mesh",
       shape("cube",
             "<transform name=\"to_world\"><scale value=\"0.375\"/><translate x=\"0.125\" "
             "z=\"2.25\"/></transform>"),
       cube_value},
  };
}

EstimatorSettings all_terms() {
  EstimatorSettings settings;
  settings.sliding = true;
  settings.corners = true;
  return settings;
}

double gradient_error(const Jet3d& found, const Jet3d& expected) {
  return glm::length(found.gradient - expected.gradient) / glm::length(expected.gradient);
}
double hessian_error(const Jet3d& found, const Jet3d& expected) {
  return (found.hessian - expected.hessian).norm() / expected.hessian.norm();
}
double distance_of(const Jet3d& a, const Jet3d& b) {
  return std::fabs(a.value - b.value) + glm::length(a.gradient - b.gradient) + (a.hessian - b.hessian).norm();
}
double size_of(const Jet3d& a) { return std::fabs(a.value) + glm::length(a.gradient) + a.hessian.norm(); }

/// Bounds of the relative errors of value, gradient and Hessian with 8 x 8 cells, some twice the measured
/// ones.
struct Bounds {
  double value;
  double gradient;
  double hessian;
};

void expect_close(const Case& light, double sigma_t, bool blocked, const Bounds& bounds) {
  SCOPED_TRACE(light.name + ", sigma_t " + std::to_string(sigma_t) + (blocked ? ", blocked" : ""));
  const Vec3f x(0.31f, -0.17f, 0.2f);
  const auto world = world_of(sigma_t, light.shape + (blocked ? half_plane : ""));
  const test::LightReferences reference(sigma_t, blocked ? test::HalfPlane{edge} : test::HalfPlane{});
  const Jet3d expected =
      test::differentiate([&](const Vec3d& at) { return light.value(reference, at); }, Vec3d(x), 2e-3);
  const Jet3d found = direct_light(*world, all_terms(), x, 4).channels[1];
  EXPECT_NEAR(found.value / expected.value, 1, bounds.value);
  EXPECT_LE(gradient_error(found, expected), bounds.gradient);
  EXPECT_LE(hessian_error(found, expected), bounds.hessian);
}

// What is flat is exact up to the transmittance's quadrature. Disks and spheres are polygons of equal solid
// angle. The ends of cylinders are chords of their circles, off by (pi / 16)^2 / 6 of the radius.
TEST(LightGather, EveryKindInTheOpen) {
  for (const Case& light : cases()) {
    const bool cylinder = light.name == "cylinder";
    const bool sphere = light.name == "sphere";
    expect_close(light, 0, false,
                 cylinder ? Bounds{0.006, 0.01, 0.015}
                 : sphere ? Bounds{1e-5, 5e-4, 1e-3}
                          : Bounds{1e-5, 1e-5, 1e-4});
    expect_close(light, 0.75, false,
                 cylinder ? Bounds{0.008, 0.01, 0.015}
                 : sphere ? Bounds{0.006, 0.012, 0.02}
                          : Bounds{3e-4, 5e-4, 1e-3});
  }
}

TEST(LightGather, EveryKindBehindABlocker) {
  for (const Case& light : cases()) {
    expect_close(light, 0, true, {0.008, 0.01, 0.05});
    expect_close(light, 0.75, true, {0.008, 0.01, 0.05});
  }
}

// A grid over nothing that blocks is the closed form whatever the settings, and costs no bisection.
TEST(LightGather, OpenLightsNeedNoBisection) {
  const Vec3f x(0.31f, -0.17f, 0.2f);
  for (const Case& light : cases()) {
    SCOPED_TRACE(light.name);
    const auto world = world_of(0.5, light.shape);
    EstimatorSettings settings = all_terms();
    const Jet3d with = direct_light(*world, settings, x).channels[0];
    settings.bisect = settings.sliding = settings.corners = false;
    const Jet3d without = direct_light(*world, settings, x).channels[0];
    EXPECT_LE(distance_of(with, without), 1e-12 * size_of(with));
    settings.leave_out = false;
    EXPECT_LE(distance_of(direct_light(*world, settings, x).channels[0], with), 1e-12 * size_of(with));
  }
}

TEST(LightGather, LightsAddUp) {
  const Vec3f x(0.31f, -0.17f, 0.2f);
  std::string all;
  Jet3d sum;
  // Side by side, so that none is in another's way.
  int place = -2;
  for (const Case& light : cases()) {
    std::string shape = light.shape;
    const std::string offset = std::to_string(3 * place++);
    const size_t end = shape.find("</transform>");
    if (end != std::string::npos) {
      shape.insert(end, "<translate x=\"" + offset + "\"/>");
    } else {
      shape.insert(shape.find("<emitter"),
                   "<transform name=\"to_world\"><translate x=\"" + offset + "\"/></transform>");
    }
    all += shape;
    sum += direct_light(*world_of(0.5, shape), all_terms(), x, 4).channels[0];
  }
  const Jet3d together = direct_light(*world_of(0.5, all), all_terms(), x, 4).channels[0];
  // Other random numbers, so the grids' own errors remain.
  EXPECT_NEAR(together.value / sum.value, 1, 2e-3);
  EXPECT_LE(gradient_error(together, sum), 5e-3);
}

TEST(LightGather, DeltaLightsAreClosedForms) {
  const Vec3f x(0.31f, -0.17f, 0.2f);
  const Vec3d position(0, 0.125, 2);
  constexpr double sigma_t = 0.75;
  const auto point = [&](const Vec3d& at) {
    const double d = glm::length(position - at);
    return 2 * std::exp(-sigma_t * d) / (4 * std::numbers::pi * d * d);
  };
  const auto spot = [&](const Vec3d& at) {
    const double angle = std::acos(glm::normalize(at - position).z * -1);
    const double degrees = angle * 180 / std::numbers::pi;
    return point(at) * std::clamp((30 - degrees) / 25, 0.0, 1.0);
  };
  const std::string at_position = "x=\"0\" y=\"0.125\" z=\"2\"";
  const auto check = [&](const std::string& light, const std::function<double(const Vec3d&)>& value) {
    SCOPED_TRACE(light);
    const Jet3d expected = test::differentiate(value, Vec3d(x), 1e-3);
    const auto world = world_of(sigma_t, light);
    const Jet3d found = direct_light(*world, {}, x).channels[2];
    EXPECT_NEAR(found.value, expected.value, 1e-6 * expected.value);
    EXPECT_LE(gradient_error(found, expected), 1e-5);
    EXPECT_LE(hessian_error(found, expected), 1e-5);
    const auto blocked = world_of(sigma_t, light + half_plane);
    const Vec3f behind(0.31f, 0.5f, 0.2f);
    EXPECT_EQ(size_of(direct_light(*blocked, {}, behind).channels[2]), 0);
  };
  check("<emitter type=\"point\"><point name=\"position\" " + at_position +
            "/><float name=\"intensity\" value=\"2\"/></emitter>",
        point);
  check("<emitter type=\"spot\"><transform name=\"to_world\"><rotate x=\"1\" angle=\"180\"/><translate " +
            at_position +
            "/></transform><float name=\"intensity\" value=\"2\"/><float name=\"cutoff_angle\" "
            "value=\"30\"/><float name=\"beam_width\" value=\"5\"/></emitter>",
        spot);
}

/// A cube of fog of half size 4 around the origin, in vacuum.
const std::string box_of_fog =
    "<shape type=\"cube\"><transform name=\"to_world\"><scale value=\"4\"/></transform><bsdf "
    "type=\"null\"/><ref name=\"interior\" id=\"fog\"/></shape>";

TEST(LightGather, ThroughTheEndOfAMedium) {
  const Vec3f x(0.31f, -0.17f, 0.2f);
  constexpr double sigma_t = 0.4;
  // Straight down into the fog: only the depth below its upper face counts.
  const auto directional =
      world_of(sigma_t, box_of_fog +
                            "<emitter type=\"directional\"><vector name=\"direction\" x=\"0\" y=\"0\" "
                            "z=\"-1\"/><float name=\"irradiance\" value=\"3\"/></emitter>");
  const Jet3d sun = direct_light(*directional, {}, x).channels[0];
  const Jet3d sun_expected = test::differentiate(
      [&](const Vec3d& at) { return 3 * std::exp(-sigma_t * (4 - at.z)) / (4 * std::numbers::pi); }, Vec3d(x),
      1e-3);
  EXPECT_NEAR(sun.value / sun_expected.value, 1, 1e-6);
  EXPECT_LE(gradient_error(sun, sun_expected), 1e-6);
  EXPECT_LE(hessian_error(sun, sun_expected), 1e-6);

  // A rectangle outside the fog: the part of each line inside is (4 - z) / (6 - z) of it.
  const auto window =
      world_of(sigma_t, box_of_fog +
                            "<shape type=\"rectangle\"><transform name=\"to_world\"><rotate x=\"1\" "
                            "angle=\"180\"/><translate z=\"6\"/></transform>" +
                            emitter + "</shape>");
  const auto nodes = test::gauss_legendre(24);
  const Jet3d expected = test::differentiate(
      [&](const Vec3d& at) {
        return test::integrate(nodes, -1, 1, [&](double u) {
          return test::integrate(nodes, -1, 1, [&](double v) {
            const Vec3d r = Vec3d(u, v, 6) - at;
            const double d = glm::length(r);
            return r.z / (d * d * d) * std::exp(-sigma_t * d * (4 - at.z) / r.z) / (4 * std::numbers::pi);
          });
        });
      },
      Vec3d(x), 1e-3);
  const Jet3d found = direct_light(*window, {}, x, 4).channels[0];
  EXPECT_NEAR(found.value / expected.value, 1, 1e-3);
  EXPECT_LE(gradient_error(found, expected), 2e-3);
  EXPECT_LE(hessian_error(found, expected), 5e-3);
}

// Points on lights, on their edges and vertices, in their planes, far away, edge-on; a light without area
// that can be seen.
TEST(LightGather, AlwaysFinite) {
  std::vector<Vec3f> points{
      {0, 0, 2},           {0.625f, 0.375f, 2}, {0.625f, 0, 2}, {5, 0, 2},         {0, 0, 2.25f},
      {0, 0.5f, 2.25f},    {0, 0, 1.75f},       {0, 0, 2.75f},  {0.75f, 0, 1.75f}, {0.5f, 0.375f, 1.875f},
      {0.125f, 0, 1.875f}, {1e6f, 1e6f, 1e6f},  {0, 0, -1e10f}, {0, -0.05f, 1}};
  for (uint32_t i = 0; i < 40; ++i) {
    RandomStream random(5, i, 0, 0);
    const float tiny = std::pow(10.0f, -8 * random.next_float());
    const Vec2f jitter = random.next_vec2() - 0.5f;
    points.push_back(points[i % 12] + tiny * Vec3f(jitter, random.next_float() - 0.5f));
  }
  for (const double sigma_t : {0.0, 0.75, 1e6}) {
    for (const Case& light : cases()) {
      SCOPED_TRACE(light.name);
      const auto world = world_of(sigma_t, light.shape + half_plane);
      for (const bool bisect : {true, false}) {
        EstimatorSettings settings = all_terms();
        settings.bisect = bisect;
        for (const Vec3f& x : points) {
          const Jet3d jet = direct_light(*world, settings, x).channels[0];
          EXPECT_TRUE(std::isfinite(size_of(jet))) << x.x << " " << x.y << " " << x.z;
          EXPECT_GE(jet.value, 0);
          EXPECT_LE(jet.value, 1.001);
        }
      }
    }
  }
}

}  // namespace
}  // namespace fogbank::derivatives
