// A few points of the comparison that `make bench` makes in real scenes (tests/bench/derivatives_comparison).
#include <gtest/gtest.h>

#include "derivatives/scene_comparison.h"

namespace fogbank::derivatives {
namespace {

struct Place {
  const test::ComparedScene& scene;
  std::vector<Vec3f> points;  ///< in a penumbra
};

TEST(RealScenes, AwareSeesPenumbraeThatUnawareDoesNot) {
  const std::vector<Place> places{
      {test::compared_scenes()[0], {Vec3f(5.07881f, 2.21538f, 4.42237f)}},
      {test::compared_scenes()[1], {Vec3f(-1.31814f, 0.904618f, 1.95048f)}},
  };
  EstimatorSettings settings;
  settings.order = Order::single;
  settings.max_depth = 2;
  settings.repeats = 1;
  for (const Place& place : places) {
    const auto world = test::load_with_finite_sun(place.scene, false);
    if (world == nullptr) GTEST_SKIP() << "shared data is absent: " << place.scene.folder;
    const auto reference = make_estimator("finite-difference", world, settings);
    const auto aware = make_estimator("aware", world, settings);
    const auto unaware = make_estimator("unaware", world, settings);
    for (const Vec3f& x : place.points) {
      SCOPED_TRACE(std::string(place.scene.name) + " at " + std::to_string(x.x));
      const Jet3d expected = average(*reference, settings, x).mean.luminance();
      const auto errors = [&](const Estimator& estimator) {
        return test::errors_of(average(estimator, settings, x).mean.luminance(), expected, {});
      };
      // Method.md section 7: 1.5 % in the penumbra with 8 x 8 cells and six bisections, against 84 %.
      EXPECT_LT(errors(*aware).gradient, 0.05);
      EXPECT_GT(errors(*unaware).gradient, 0.3);
    }
  }
}

}  // namespace
}  // namespace fogbank::derivatives
