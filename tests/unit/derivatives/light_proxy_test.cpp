// Unoccluded lights in closed form: against the lights' own solid angles, finite differences and exact
// integrals.
#include "derivatives/light_proxy.h"

#include <gtest/gtest.h>

#include <cmath>

#include "derivatives/exact_light_visibility.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using transport::test::parse_world;

std::shared_ptr<const transport::World> world_with(const std::string& light) {
  return parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3, 0.5, 0.8"/><rgb name="albedo" value="0.5"/></medium>
    <sensor type="perspective"><ref name="medium" id="fog"/></sensor>)" +
                     light);
}

const char* const radiance = R"(<emitter type="area"><rgb name="radiance" value="3, 2, 1"/></emitter>)";

struct Kind {
  const char* name;
  std::string shape;
  double tolerance;  ///< besides what the transmittance of a piece's middle leaves: half its optical diameter
};

std::vector<Kind> kinds() {
  return {{"rectangle",
           R"(<shape type="rectangle"><transform name="to_world"><scale x="0.4" y="0.7"/></transform>)" +
               std::string(radiance) + "</shape>",
           1e-3},
          {"disk",
           R"(<shape type="disk"><transform name="to_world"><scale value="0.4"/></transform>)" +
               std::string(radiance) + "</shape>",
           1e-3},
          {"sphere",
           R"(<shape type="sphere"><float name="radius" value="0.2"/>)" + std::string(radiance) + "</shape>",
           0.1}};
}

const std::vector<Vec3f> points{{0.2f, 0.3f, 0.7f}, {-1.5f, 0.4f, 0.6f}, {0.1f, -0.1f, 4.0f}};

TEST(LightProxy, IsWhatArrivesWithoutSurfaces) {
  for (const Kind& kind : kinds()) {
    SCOPED_TRACE(kind.name);
    const auto world = world_with(kind.shape);
    const transport::Plan plan(*world, {.from_medium = false, .max_depth = 2});
    const auto proxy = LightProxy::make(*world, plan, 0, 0);
    ASSERT_TRUE(proxy.has_value());
    RayCounters counters;
    for (const Vec3f& x : points) {
      const Vec3d exact = exact_direct_light(*world, plan, 0, Vec3d(x), 0, {}, counters);
      const Spectrum value = proxy->value(x);
      for (int c = 0; c < 3; ++c) {
        EXPECT_NEAR(static_cast<double>(value[c]), exact[c],
                    (kind.tolerance + static_cast<double>(proxy->greatest_ratio()) - 1) * exact[c]);
        EXPECT_LE(exact[c], static_cast<double>(value[c] * proxy->greatest_ratio()));
      }
    }
  }
}

TEST(LightProxy, JetsAreTheValuesDerivatives) {
  for (const Kind& kind : kinds()) {
    SCOPED_TRACE(kind.name);
    const auto world = world_with(kind.shape);
    const transport::Plan plan(*world, {.from_medium = false, .max_depth = 2});
    const auto proxy = LightProxy::make(*world, plan, 0, 0);
    ASSERT_TRUE(proxy.has_value());
    const double step = 1e-4;
    for (const Vec3f& point : points) {
      const Vec3d x(point);
      const RadianceJet jet = proxy->jet(x, 1e-12);
      for (size_t c = 0; c < 3; ++c) {
        const Jet3d& here = jet.channels[c];
        // Floats of the value, some 10 operations of 1e-7.
        EXPECT_NEAR(here.value, static_cast<double>(proxy->value(point)[static_cast<int>(c)]),
                    1e-5 * here.value);
        for (int axis = 0; axis < 3; ++axis) {
          Vec3d offset(0);
          offset[axis] = step;
          const Jet3d above = proxy->jet(x + offset, 1e-12).channels[c];
          const Jet3d below = proxy->jet(x - offset, 1e-12).channels[c];
          // Central differences err by step^2 times third derivatives, which are below 1e3 values here.
          EXPECT_NEAR(here.gradient[axis], (above.value - below.value) / (2 * step), 1e-4 * here.value);
          const Vec3d column = (above.gradient - below.gradient) / (2 * step);
          for (int row = 0; row < 3; ++row) {
            Vec3d e(0);
            e[row] = 1;
            Vec3d a(0);
            a[axis] = 1;
            EXPECT_NEAR(glm::dot(e, here.hessian * a), column[row], 2e-4 * here.value) << axis << row;
          }
        }
      }
    }
  }
}

TEST(LightProxy, OneSidedLightsSendNothingBehindAndImagesHaveNone) {
  const auto world = world_with(kinds()[0].shape);
  const transport::Plan plan(*world, {.from_medium = false, .max_depth = 2});
  const auto proxy = LightProxy::make(*world, plan, 0, 0);
  ASSERT_TRUE(proxy.has_value());
  EXPECT_EQ(proxy->value({0.1f, 0, -0.5f}), Spectrum(0));
  EXPECT_EQ(proxy->jet({0.1, 0, -0.5}, 1e-12).luminance().value, 0);

  const auto delta = world_with(R"(<emitter type="point"><rgb name="intensity" value="1"/></emitter>)");
  EXPECT_FALSE(
      LightProxy::make(*delta, transport::Plan(*delta, {.from_medium = false, .max_depth = 2}), 0, 0));
  const auto sky = world_with(R"(<emitter type="constant"><rgb name="radiance" value="1"/></emitter>)");
  EXPECT_FALSE(LightProxy::make(*sky, transport::Plan(*sky, {.from_medium = false, .max_depth = 2}), 0, 0));
}

}  // namespace
}  // namespace fogbank::derivatives
