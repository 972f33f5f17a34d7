// The aware estimator as a whole: its parts add up, same bits, finite wherever it is asked.
#include <gtest/gtest.h>

#include <cmath>
#include <thread>

#include "derivatives/estimator.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using transport::test::load_world;
using transport::test::parse_world;

EstimatorSettings small(Order order) {
  EstimatorSettings settings;
  settings.order = order;
  settings.samples = 64;
  return settings;
}

RadianceJet estimate(const std::shared_ptr<const transport::World>& world, const EstimatorSettings& settings,
                     const Vec3f& x, uint32_t repeat = 0) {
  scene::prepare_render_thread();
  RayCounters counters;
  return make_estimator("aware", world, settings)->estimate(x, repeat, counters);
}

bool is_finite(const RadianceJet& jet) {
  bool finite = true;
  for (const Jet3d& channel : jet.channels) {
    finite = finite && std::isfinite(channel.value);
    for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(channel.gradient[i]);
    for (const double entry : channel.hessian.entries) finite = finite && std::isfinite(entry);
  }
  return finite;
}

TEST(Aware, OrdersAddUp) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const Vec3f x(0.3f, 0.2f, 0.4f);
  const RadianceJet single = estimate(world, small(Order::single), x);
  const RadianceJet multiple = estimate(world, small(Order::multiple), x);
  const RadianceJet both = estimate(world, small(Order::both), x);
  // All but derivatives of the medium's light, whose outlines depend on what else is known of the rays.
  for (size_t c = 0; c < 3; ++c)
    EXPECT_NEAR(both.channels[c].value, single.channels[c].value + multiple.channels[c].value,
                1e-12 * both.channels[c].value);
}

TEST(Aware, SameBitsInAnyThread) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const Vec3f x(-0.2f, 0.5f, 0.7f);
  const RadianceJet first = estimate(world, small(Order::both), x, 3);
  RadianceJet second;
  std::thread([&] { second = estimate(world, small(Order::both), x, 3); }).join();
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_EQ(first.channels[c].value, second.channels[c].value);
    EXPECT_EQ(first.channels[c].gradient, second.channels[c].gradient);
    EXPECT_EQ(first.channels[c].hessian.entries, second.channels[c].hessian.entries);
  }
  EXPECT_NE(first.channels[0].value, estimate(world, small(Order::both), x, 4).channels[0].value);
}

TEST(Aware, DerivativesDoNotChangeTheValue) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const Vec3f x(0.3f, 0.2f, 0.4f);
  for (const Order order : {Order::single, Order::multiple}) {
    EstimatorSettings settings = small(order);
    settings.bisect = false;
    const RadianceJet hessian = estimate(world, settings, x);
    settings.derivatives = DerivativeOrder::gradient;
    const RadianceJet gradient = estimate(world, settings, x);
    settings.derivatives = DerivativeOrder::value;
    const RadianceJet value = estimate(world, settings, x);
    for (size_t c = 0; c < 3; ++c) {
      EXPECT_DOUBLE_EQ(hessian.channels[c].value, value.channels[c].value);
      EXPECT_DOUBLE_EQ(gradient.channels[c].value, value.channels[c].value);
      for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(gradient.channels[c].gradient[i], hessian.channels[c].gradient[i],
                    1e-6 * glm::length(hessian.channels[c].gradient));
    }
  }
}

TEST(Aware, ShortPathsEndBeforeReflections) {
  const auto world = load_world("scenes/penumbra", "penumbra.xml");
  const Vec3f x(0.3f, 0.2f, 0.4f);
  EstimatorSettings settings = small(Order::both);
  settings.max_depth = 1;
  EXPECT_EQ(estimate(world, settings, x).luminance().value, 0);
  settings.max_depth = 2;
  const double direct = estimate(world, settings, x).luminance().value;
  settings.max_depth = -1;
  EXPECT_GT(direct, 0);
  EXPECT_GT(estimate(world, settings, x).luminance().value, direct);
}

TEST(Aware, FiniteEverywhere) {
  const auto penumbra = load_world("scenes/penumbra", "penumbra.xml");
  // In the middle, on and next to walls, on the light, out of the room, far out, at the origin of everything.
  for (const Vec3f x : {Vec3f(0), Vec3f(3, 0, 0.5f), Vec3f(2.9999998f, 3.1999998f, 1.9999999f),
                        Vec3f(0, 0, 2), Vec3f(0, 100, 0), Vec3f(1e7f, -1e7f, 1e7f), Vec3f(0.3f, 0.2f, 0)})
    EXPECT_TRUE(is_finite(estimate(penumbra, small(Order::both), x))) << x.x << ' ' << x.y << ' ' << x.z;
  const auto empty = parse_world("");
  EXPECT_EQ(estimate(empty, small(Order::both), {1, 2, 3}).luminance().value, 0);
  const auto mirrors = parse_world(R"(<emitter type="constant"/>
    <shape type="cube"><bsdf type="conductor"/></shape>
    <shape type="sphere"><float name="radius" value="0.3"/><bsdf type="dielectric"/></shape>)");
  EXPECT_TRUE(is_finite(estimate(mirrors, small(Order::both), {0.5f, 0.5f, 0.5f})));
}

TEST(Aware, ClosedRoomWithEveryCoefficientAtItsLimit) {
  for (const char* sigma_t : {"1e-30", "1e10"}) {
    const auto world = parse_world(R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" +
                                   std::string(sigma_t) + R"("/><rgb name="albedo" value="0.999999"/></medium>
      <sensor type="perspective"><ref id="fog"/></sensor>
      <shape type="cube"/><shape type="sphere"><float name="radius" value="0.2"/>
        <emitter type="area"><rgb name="radiance" value="1e20"/></emitter></shape>)");
    EXPECT_TRUE(is_finite(estimate(world, small(Order::single), {0.5f, 0.4f, 0.3f}))) << sigma_t;
  }
}

}  // namespace
}  // namespace fogbank::derivatives
