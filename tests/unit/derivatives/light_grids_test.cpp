// Lights whose grids have something special to them: images, meshes of many triangles, emitters all around,
// suns.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

#include "core/random.h"
#include "derivatives/light_gather.h"
#include "derivatives/plan_request.h"
#include "derivatives/quadrature.h"
#include "derivatives/text_scene.h"
#include "derivatives/triangle_form_factor.h"
#include "scene/loader.h"
#include "scene/memory_files.h"

namespace fogbank::derivatives {
namespace {

struct Found {
  Jet3d jet;
  double rays = 0;
};

Found direct_light(const transport::World& world, const EstimatorSettings& settings, const Vec3f& x,
                   uint32_t repeats) {
  const transport::Plan plan(world, plan_request(settings));
  const LightGather gather(world, plan, settings);
  RadianceJet sum;
  RayCounters counters;
  for (uint32_t i = 0; i < repeats; ++i) {
    RandomStream random(3, i, 0, 0);
    gather.add(x, world.medium_at(x), random, sum, counters);
  }
  return {sum.channels[0] * (1.0 / repeats), static_cast<double>(counters.total()) / repeats};
}

double gradient_error(const Jet3d& found, const Jet3d& expected) {
  return glm::length(found.gradient - expected.gradient) / glm::length(expected.gradient);
}

/// A Radiance picture without run lengths: shared exponents, so values are exact that are powers of two.
std::string radiance_picture(int width, int height, const std::function<double(int, int)>& value) {
  std::string file = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y " + std::to_string(height) + " +X " +
                     std::to_string(width) + "\n";
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      int exponent = 0;
      const double mantissa = std::frexp(value(x, y), &exponent);
      const char grey = static_cast<char>(static_cast<unsigned char>(mantissa * 256));
      file += {grey, grey, grey, static_cast<char>(static_cast<unsigned char>(exponent + 128))};
    }
  }
  return file;
}

std::shared_ptr<transport::World> world_under(const std::string& picture, const std::string& body) {
  scene::prepare_render_thread();
  const std::string file =
      "<scene version=\"3.0.0\"><emitter type=\"envmap\"><string name=\"filename\" "
      "value=\"sky.hdr\"/></emitter>" +
      body + "</scene>";
  return std::make_shared<transport::World>(
      scene::load_scene("scene.xml",
                        std::make_shared<scene::test::MemoryFiles>(
                            std::map<std::string, std::string>{{"scene.xml", file}, {"sky.hdr", picture}}),
                        {}));
}

/// A dim sky, brighter upwards (local y), with a patch that sends most of the light.
double sky(int x, int y) {
  if (x >= 20 && x < 23 && y >= 8 && y < 10) return 64;
  return y < 16 ? 0.5 : 0.25;
}

const std::string plate =
    "<shape type=\"rectangle\"><transform name=\"to_world\"><rotate x=\"1\" angle=\"90\"/><translate "
    "y=\"1\"/>"
    "</transform></shape>";

/// Monte Carlo mean by the light's own sampling.
double sampled_mean(const transport::World& world, const Vec3f& x, uint32_t samples) {
  RayCounters counters;
  double sum = 0;
  for (uint32_t i = 0; i < samples; ++i) {
    RandomStream random(1, i, 0, 0);
    const auto sample = world.lights().light(0).sample(x, random.next_vec2());
    if (!sample) continue;
    const Spectrum through = world.visibility(x, sample->direction, sample->distance, scene::none, counters);
    sum += static_cast<double>(sample->radiance.x * through.x / sample->pdf);
  }
  return sum / samples / (4 * std::numbers::pi);
}

TEST(LightGrids, ImageInTheOpenIsItsMean) {
  const auto world = world_under(radiance_picture(64, 32, sky), "");
  const Found found = direct_light(*world, {}, {0.1f, 0.2f, 0.3f}, 1);
  // 40,000 samples with a variance of about a tenth of the mean squared: 1.6e-3 at one standard error.
  EXPECT_NEAR(found.jet.value / sampled_mean(*world, {0.1f, 0.2f, 0.3f}, 40000), 1, 6e-3);
  EXPECT_EQ(glm::length(found.jet.gradient), 0);
  EXPECT_EQ(found.jet.hessian.norm(), 0);
}

TEST(LightGrids, ImageBehindABlocker) {
  const auto world = world_under(radiance_picture(64, 32, sky), plate);
  const Vec3f x(0.4f, 0.3f, 0.5f);
  const Found found = direct_light(*world, {}, x, 1);
  EXPECT_NEAR(found.jet.value / sampled_mean(*world, x, 40000), 1, 0.02);
  EXPECT_GT(glm::length(found.jet.gradient), 0);
}

// A uniform sky: what a plate blocks of it is the plate's form factor, and so are the derivatives.
TEST(LightGrids, PlateBeforeAUniformSky) {
  const auto world = world_under(radiance_picture(64, 32, [](int, int) { return 1; }), plate);
  const Vec3f x(0.4f, 0.3f, 0.5f);
  const std::array<Vec3d, 4> corners{Vec3d(-1, 1, -1), Vec3d(1, 1, -1), Vec3d(1, 1, 1), Vec3d(-1, 1, 1)};
  const auto triangle = [&](int a, int b, int c) {
    return triangle_form_factor_jet(RelativeTriangle<double>::from_world(
        Vec3d(x), corners[static_cast<size_t>(a)], corners[static_cast<size_t>(b)],
        corners[static_cast<size_t>(c)]));
  };
  Jet3d expected = triangle(0, 1, 2) + triangle(0, 2, 3);
  if (expected.value > 0) expected *= -1;
  expected.value += 1;
  const Found found = direct_light(*world, {}, x, 1);
  // Measured: 0.4 % of the gradient, falling with the cells' area; the cells are blind to corners within
  // them.
  EXPECT_NEAR(found.jet.value, expected.value, 0.001);
  EXPECT_LE(gradient_error(found.jet, expected), 0.01);
}

/// A latitude-longitude globe as an OBJ file.
std::string globe(int rings, int segments, double radius) {
  std::string file;
  const auto vertex = [&](double polar, double azimuth) {
    file += "v " + std::to_string(radius * std::sin(polar) * std::cos(azimuth)) + " " +
            std::to_string(radius * std::sin(polar) * std::sin(azimuth)) + " " +
            std::to_string(3 + radius * std::cos(polar)) + "\n";
  };
  for (int r = 0; r <= rings; ++r)
    for (int s = 0; s < segments; ++s)
      vertex(std::numbers::pi * r / rings, 2 * std::numbers::pi * s / segments);
  const auto at = [&](int r, int s) { return std::to_string(r * segments + s % segments + 1); };
  for (int r = 0; r < rings; ++r) {
    for (int s = 0; s < segments; ++s) {
      if (r > 0) file += "f " + at(r, s) + " " + at(r + 1, s) + " " + at(r, s + 1) + "\n";
      if (r + 1 < rings) file += "f " + at(r, s + 1) + " " + at(r + 1, s) + " " + at(r + 1, s + 1) + "\n";
    }
  }
  return file;
}

// Thousands of triangles: rays stay bounded, and the unoccluded sum stays the closed form.
TEST(LightGrids, MeshOfManyTriangles) {
  scene::prepare_render_thread();
  const auto world_of = [](const std::string& body) {
    return std::make_shared<transport::World>(
        scene::load_scene("scene.xml",
                          std::make_shared<scene::test::MemoryFiles>(std::map<std::string, std::string>{
                              {"scene.xml",
                               "<scene version=\"3.0.0\"><shape type=\"obj\"><string name=\"filename\" "
                               "value=\"globe.obj\"/><emitter "
                               "type=\"area\"><float name=\"radiance\" value=\"1\"/></emitter></shape>" +
                                   body + "</scene>"},
                              {"globe.obj", globe(60, 120, 0.5)}}),
                          {}));
  };
  const Vec3f x(0.3f, 0.1f, 0.2f);
  // Nothing is before a convex light but the light itself, whose rim may hide a ray.
  const Found open = direct_light(*world_of(""), {}, x, 8);
  const Jet3d expected = test::differentiate(
      [](const Vec3d& at) {
        const double d = glm::length(Vec3d(0, 0, 3) - at);
        return 0.5 * (1 - std::sqrt(1 - 0.25 / (d * d)));
      },
      Vec3d(x), 1e-3);
  EXPECT_NEAR(open.jet.value / expected.value, 1, 0.01);
  EXPECT_LE(gradient_error(open.jet, expected), 0.02);
  EXPECT_LE(open.rays, 3 * 128 + 200);

  // Half of it hidden: y > 0.05 at z = 1.
  const auto hidden = world_of(
      "<shape type=\"rectangle\"><transform name=\"to_world\"><scale value=\"20\"/><translate y=\"20.08\" "
      "z=\"1\"/></transform></shape>");
  const Found found = direct_light(*hidden, {}, x, 16);
  RayCounters counters;
  double sum = 0;
  constexpr uint32_t samples = 40000;
  for (uint32_t i = 0; i < samples; ++i) {
    RandomStream random(1, i, 0, 0);
    float u = random.next_float();
    const auto choice = hidden->lights().choose(transport::LightReceiver{x, Vec3f(0), 0}, u);
    if (!choice) continue;
    const auto sample = hidden->lights().light(choice->light).sample(x, random.next_vec2());
    if (!sample) continue;
    sum += static_cast<double>(
        sample->radiance.x / (sample->pdf * choice->probability) *
        hidden->visibility(x, sample->direction, sample->distance, scene::none, counters).x);
  }
  EXPECT_NEAR(found.jet.value / (sum / samples / (4 * std::numbers::pi)), 1, 0.03);
  EXPECT_LE(found.rays, 3 * 128 + 8 * 3 * 128);
}

// Inside an emitter of radiance 1 in vacuum there is nothing but radiance 1; with absorption the middle is
// the darkest place and no direction is preferred there.
TEST(LightGrids, InsideAnInwardSphere) {
  const std::string sphere =
      "<shape type=\"sphere\"><float name=\"radius\" value=\"2\"/><boolean name=\"flip_normals\" "
      "value=\"true\"/>"
      "<emitter type=\"area\"><float name=\"radiance\" value=\"1\"/></emitter></shape>";
  const auto clear = test::world_in_fog("0", "0.5", sphere);
  const Found found = direct_light(*clear, {}, {0.3f, -0.2f, 0.9f}, 1);
  EXPECT_NEAR(found.jet.value, 1, 1e-12);
  EXPECT_NEAR(glm::length(found.jet.gradient), 0, 1e-12);
  EXPECT_NEAR(found.jet.hessian.norm(), 0, 1e-12);

  constexpr double sigma_t = 0.5;
  const auto fog = test::world_in_fog("0.5", "0.5", sphere);
  const Vec3f x(0.3f, -0.2f, 0.9f);
  const auto nodes = test::gauss_legendre(48);
  const Jet3d expected = test::differentiate(
      [&](const Vec3d& at) {
        const double d = glm::length(at);
        return test::integrate(nodes, -1, 1,
                               [&](double cosine) {
                                 const double wall =
                                     -d * cosine + std::sqrt(4 - d * d * (1 - cosine * cosine));
                                 return std::exp(-sigma_t * wall);
                               }) /
               2;
      },
      Vec3d(x), 1e-3);
  const Found dim = direct_light(*fog, {}, x, 4);
  EXPECT_NEAR(dim.jet.value / expected.value, 1, 2e-3);
  EXPECT_LE(gradient_error(dim.jet, expected), 0.02);
}

// A sun: a disk of a quarter of a degree, a thousand times as far as what blocks it.
TEST(LightGrids, SunBehindAnEdge) {
  const auto world = test::world_in_fog(
      "0", "0.5",
      "<shape type=\"disk\"><transform name=\"to_world\"><rotate x=\"1\" angle=\"180\"/><scale "
      "value=\"4.65\"/><translate z=\"1000\"/></transform><emitter type=\"area\"><float name=\"radiance\" "
      "value=\"1000\"/></emitter></shape><shape type=\"rectangle\"><transform name=\"to_world\"><translate "
      "y=\"1\" z=\"1\"/></transform></shape>");
  const double radius = static_cast<double>(4.65f);
  // What the edge y = 0 at z = 1 leaves of the disk, seen almost along its axis.
  const auto value = [&](const Vec3d& at) {
    const double height = 1000 - at.z;
    const double cut = std::clamp((at.y - at.y * height / (1 - at.z)) / radius, -1.0, 1.0);
    const double area =
        radius * radius * (std::asin(cut) + cut * std::sqrt(1 - cut * cut) + std::numbers::pi / 2);
    return 1000 * area / (height * height) / (4 * std::numbers::pi);
  };
  const Vec3f x(0, 0.0015f, 0);
  const Jet3d expected = test::differentiate(value, Vec3d(x), 1e-5);
  const Found found = direct_light(*world, {}, x, 16);
  EXPECT_NEAR(found.jet.value / expected.value, 1, 2e-3);
  EXPECT_LE(gradient_error(found.jet, expected), 0.01);
}

}  // namespace
}  // namespace fogbank::derivatives
