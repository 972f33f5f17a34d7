// Irradiance gathered over a hemisphere against closed forms: sources are given by functions.
#include <gtest/gtest.h>

#include <functional>

#include "derivatives/irradiance_edge.h"
#include "derivatives/irradiance_gather.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using transport::test::parse_world;

/// Sources without noise: radiance by shape and place, mean radiance by place.
struct Functions final : LineSource, SurfaceSource {
  std::function<double(uint32_t shape, const Vec3f& y)> surfaces;
  std::function<double(const Vec3f& y)> medium = [](const Vec3f&) { return 0.0; };
  double sigma_t = 0;
  double sigma_s = 0;

  Spectrum in_scattered(const Ray& ray, float length, int32_t, RandomStream& random,
                        RayCounters&) const override {
    // Strata of equal importance.
    constexpr int strata = 32;
    const double share = -std::expm1(-sigma_t * static_cast<double>(length));
    double sum = 0;
    for (int i = 0; i < strata; ++i) {
      const double u = (i + static_cast<double>(random.next_float())) / strata;
      sum += medium(ray.at(static_cast<float>(-std::log1p(-u * share) / sigma_t)));
    }
    return Spectrum(static_cast<float>(sum / strata * sigma_s / sigma_t * share));
  }
  Spectrum leaving_radiance(const SurfaceHit& hit, int32_t, RandomStream&, RayCounters&) const override {
    return Spectrum(static_cast<float>(surfaces(hit.surface.shape, hit.surface.position)));
  }
};

/// The floor at `position`, normal up.
SurfaceSide floor_at(const Vec3f& position, int32_t medium = scene::none) {
  SurfaceSide side;
  side.surface.position = position;
  side.surface.position_error = Vec3f(1e-6f);
  side.surface.geometric_normal = {0, 0, 1};
  side.normal = {0, 0, 1};
  side.medium = medium;
  return side;
}

/// Mean over independent estimates.
RadianceJet mean_estimate(const transport::World& world, const Functions& sources, const SurfaceSide& side,
                          const IrradianceSettings& settings, int repeats) {
  RadianceJet sum;
  RayCounters counters;
  for (int k = 0; k < repeats; ++k) {
    RandomStream random(11, static_cast<uint32_t>(k), 0, 0);
    sum += gather_irradiance(world, {sources, sources}, side, settings, random, counters).mean;
  }
  return sum *= 1.0 / repeats;
}

const std::string diffuse = R"(<bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf>)";

/// A closed room of |x| <= 2, |y| <= 3, 0 <= z <= 2.
const std::string empty_room = R"(
  <shape type="cube"><transform name="to_world"><scale x="2" y="3" z="1"/><translate z="1"/></transform>)" +
                               diffuse + "</shape>";
/// With things in it that block the view.
const std::string room = empty_room + R"(
  <shape type="sphere"><point name="center" x="0.8" y="1" z="0.9"/><float name="radius" value="0.3"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.2"/><rotate z="1" angle="30"/>
    <translate x="-1" y="-0.5" z="0.3"/></transform></shape>)";

std::string fog(const std::string& sigma_t, const std::string& albedo) {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo +
         R"("/></medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)";
}

TEST(IrradianceGather, UniformSurroundingsHaveValueOneAndNoDerivatives) {
  const auto world = parse_world(room);
  Functions sources;
  sources.surfaces = [](uint32_t, const Vec3f&) { return 1.0; };
  for (const bool bisect : {false, true}) {
    const RadianceJet jet =
        mean_estimate(*world, sources, floor_at({0.3f, 0.2f, 0}), {.samples = 64, .bisect = bisect}, 1);
    // Directions, distances and weights are single precision.
    EXPECT_NEAR(jet.channels[0].value, 1, 1e-5);
    EXPECT_LE(glm::length(jet.channels[0].gradient), 1e-4);
    EXPECT_LE(jet.channels[0].hessian.norm(), 1e-3);
  }
}

TEST(IrradianceGather, LosslessFogInUniformLightChangesNothing) {
  // Furnace: what the fog takes from the walls' light it sends out itself.
  const auto world = parse_world(fog("0.7, 0.7, 0.7", "1, 1, 1") + room);
  Functions sources;
  sources.surfaces = [](uint32_t, const Vec3f&) { return 1.0; };
  sources.medium = [](const Vec3f&) { return 1.0; };
  sources.sigma_t = sources.sigma_s = 0.7;
  const RadianceJet jet = mean_estimate(*world, sources, floor_at({0.3f, 0.2f, 0}, 0), {.samples = 64}, 1);
  EXPECT_NEAR(jet.channels[0].value, 1, 1e-3);
  EXPECT_LE(glm::length(jet.channels[0].gradient), 1e-3);
  EXPECT_LE(jet.channels[0].hessian.norm(), 1e-2);
}

TEST(IrradianceGather, UnboundedFogOfLinearSource) {
  // Over a plane: the mean of the source at distance s along rays weighted by the cosine, whose horizontal
  // part is that at the point: value albedo (q(x) + 2/3 g_z / sigma_t), gradient albedo times the horizontal
  // one, no Hessian.
  const auto world = parse_world(fog("2, 2, 2", "0.5, 0.5, 0.5") +
                                 R"(<shape type="disk"><transform name="to_world"><scale value="10"/>
      </transform></shape>)");
  Functions sources;
  sources.surfaces = [](uint32_t, const Vec3f&) { return 0.0; };
  sources.medium = [](const Vec3f& y) {
    return 2 + 0.5 * static_cast<double>(y.x) - 0.25 * static_cast<double>(y.y) +
           0.125 * static_cast<double>(y.z);
  };
  sources.sigma_t = 2;
  sources.sigma_s = 1;
  const Vec3f x(0.4f, -0.2f, 0);
  const RadianceJet jet = mean_estimate(*world, sources, floor_at(x, 0), {.samples = 256}, 16);
  // 32 strata a ray, 16^2 directions.
  const double value = 0.5 * (2 + 0.5 * 0.4 + 0.25 * 0.2 + 0.125 * 2 / 3 / 2);
  EXPECT_NEAR(jet.channels[0].value, value, 2e-3 * value);
  // Radiance is smoothed over neighbouring rays, which takes some 3 % off.
  EXPECT_NEAR(jet.channels[0].gradient.x, 0.25, 0.01);
  EXPECT_NEAR(jet.channels[0].gradient.y, -0.125, 0.005);
  EXPECT_EQ(jet.channels[0].gradient.z, 0);
  // Of the gradient over the mean free path: one distance a ray stands for all, and radii go by the fourth
  // root.
  EXPECT_LE(jet.channels[0].hessian.norm(), 0.3 * 0.25 * 2);
}

/// A reflector hung over the floor; what it sends out is 1, everything else is black.
struct Reflector {
  std::array<Vec3d, 4> corners;

  Jet3d form_factor(const Vec3d& x) const {
    Jet3d sum;
    // The rectangle faces down: counter-clockwise seen from above is its corners' order.
    for (size_t i = 0; i < 4; ++i)
      sum += irradiance_edge_term(corners[i] - x, corners[(i + 1) % 4] - x, Vec3d(0, 0, 1));
    return sum;
  }
};

const Reflector reflector{{Vec3d(-0.5, -0.5, 1), Vec3d(1, -0.5, 1), Vec3d(1, 0.75, 1), Vec3d(-0.5, 0.75, 1)}};
const std::string reflector_shape = R"(<shape type="rectangle"><transform name="to_world">
    <scale x="0.75" y="0.625"/><translate x="0.25" y="0.125" z="1"/></transform></shape>)";

TEST(IrradianceGather, PolygonalReflector) {
  const auto world = parse_world(reflector_shape + empty_room);
  Functions sources;
  sources.surfaces = [](uint32_t shape, const Vec3f&) { return shape == 0 ? 1.0 : 0.0; };
  for (const Vec3f& x : {Vec3f(0, 0, 0), Vec3f(0.9f, 1.2f, 0), Vec3f(-1.2f, 0.6f, 0)}) {
    const Jet3d truth = reflector.form_factor(Vec3d(x));
    const RadianceJet jet = mean_estimate(*world, sources, floor_at(x), {.samples = 1024}, 24);
    // 24 x 32^2 strata; an edge crosses some 100 of each 1024: below 0.3 % of the hemisphere.
    EXPECT_NEAR(jet.channels[0].value, truth.value, 1e-3);
    Vec3d gradient = truth.gradient;
    gradient.z = 0;
    EXPECT_LE(glm::length(jet.channels[0].gradient - gradient), 0.05 * glm::length(gradient) + 0.003);
    double hessian_error = 0;
    double hessian_size = 0;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j) {
        hessian_error += sqr(static_cast<float>(jet.channels[0].hessian(i, j) - truth.hessian(i, j)));
        hessian_size += truth.hessian(i, j) * truth.hessian(i, j);
      }
    EXPECT_LE(std::sqrt(hessian_error), 0.1 * std::sqrt(hessian_size));
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(jet.channels[0].hessian(i, 2), 0, 1e-9);
  }
}

TEST(IrradianceGather, GradientInThePenumbraOfABlocker) {
  // A plate below the reflector hides part of it: finite differences of the value by quadrature.
  const std::string blocker = R"(<shape type="rectangle"><transform name="to_world">
      <scale x="0.2" y="0.8"/><translate x="-0.1" z="0.5"/></transform></shape>)";
  const auto world = parse_world(reflector_shape + blocker + empty_room);
  Functions sources;
  sources.surfaces = [](uint32_t shape, const Vec3f&) { return shape == 0 ? 1.0 : 0.0; };
  // Irradiance over pi by the midpoint rule over the reflector.
  const auto irradiance = [](double x, double y) {
    constexpr int steps = 400;
    double sum = 0;
    for (int i = 0; i < steps; ++i)
      for (int j = 0; j < steps; ++j) {
        const double u = -0.5 + 1.5 * (i + 0.5) / steps;
        const double v = -0.5 + 1.25 * (j + 0.5) / steps;
        // Where the line to (u, v, 1) crosses the plate's plane, z = 1/2.
        const double cx = (x + u) / 2;
        const double cy = (y + v) / 2;
        if (std::abs(cx + 0.1) < 0.2 && std::abs(cy) < 0.8) continue;
        const double square = (u - x) * (u - x) + (v - y) * (v - y) + 1;
        sum += 1 / (M_PI * square * square);
      }
    return sum * 1.5 * 1.25 / steps / steps;
  };
  const Vec3f x(0.25f, 0.1f, 0);
  const double h = 0.03;
  const Vec2d truth((irradiance(0.25 + h, 0.1) - irradiance(0.25 - h, 0.1)) / (2 * h),
                    (irradiance(0.25, 0.1 + h) - irradiance(0.25, 0.1 - h)) / (2 * h));
  const RadianceJet bisected = mean_estimate(*world, sources, floor_at(x), {.samples = 256}, 64);
  EXPECT_NEAR(bisected.channels[0].value, irradiance(0.25, 0.1), 2e-3);
  // The mean over many grids shows what bias is left: 2 %, without bisection 21 %.
  EXPECT_LE(glm::length(Vec2d(bisected.channels[0].gradient) - truth), 0.05 * glm::length(truth));
}

TEST(IrradianceGather, SmoothNormalsTakeTheCosine) {
  // Half the directions around a shading normal tilted by 60 degrees lie below the surface: what they see is
  // counted as the path tracer counts it, from the other side.
  const auto world = parse_world(empty_room + R"(<shape type="rectangle"><transform name="to_world">
      <translate z="1"/></transform></shape>)");
  Functions sources;
  sources.surfaces = [](uint32_t, const Vec3f& y) { return y.z > 1 ? 1.0 : 0.25; };
  SurfaceSide side = floor_at({0, 0, 1});
  side.normal = {std::sqrt(0.75f), 0, 0.5f};
  const RadianceJet jet = mean_estimate(*world, sources, side, {.samples = 256}, 64);
  // Above the surface lies (1 + cos 60) / 2 of the cosine-weighted hemisphere.
  EXPECT_NEAR(jet.channels[0].value, 0.75 + 0.25 * 0.25, 2e-3);
}

}  // namespace
}  // namespace fogbank::derivatives
