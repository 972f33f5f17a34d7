// Direct light and its derivatives in scenes/penumbra, against quadrature over what the plates leave of the
// light.
#include <gtest/gtest.h>

#include <algorithm>

#include "core/random.h"
#include "derivatives/light_gather.h"
#include "derivatives/penumbra_reference.h"
#include "scene/loader.h"

namespace fogbank::derivatives {
namespace {

constexpr float radiance_red = 26;

struct Sample {
  Vec3f x;
  Jet3d reference;  ///< for unit radiance
};

/// Points of one zone, by the share of the light that they see, where finite differences are reliable.
std::vector<Sample> points_of_zone(const test::PenumbraReference& reference, double least, double most,
                                   size_t count) {
  std::vector<Sample> points;
  for (uint32_t i = 0; points.size() < count; ++i) {
    RandomStream random(11, i, 0, 0);
    const Vec3f x(4 * random.next_float() - 2, 3 * random.next_float() - 1.5f,
                  2.4f * random.next_float() - 0.9f);
    const double share = reference.visible_share(Vec3d(x));
    if (share < least || share > most) continue;
    // Beside the upper plate's level a point may lie on it.
    if (std::fabs(x.z - 1) < 0.02 || std::fabs(x.z - 0.3f) < 0.02) continue;
    bool reliable = false;
    const Jet3d jet = reference.jet(Vec3d(x), reliable);
    if (reliable) points.push_back({x, jet});
  }
  return points;
}

struct Errors {
  double gradient_mean = 0;  ///< sum of errors over sum of lengths
  double gradient_median = 0;
  double hessian_mean = 0;
  double hessian_median = 0;
  double bias = 0;  ///< of the value
  double rays = 0;  ///< per point
};

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<ptrdiff_t>(values.size() / 2), values.end());
  return values[values.size() / 2];
}

Errors errors_of(const transport::World& world, const EstimatorSettings& settings,
                 const std::vector<Sample>& points) {
  const LightGather gather(world, settings);
  std::vector<double> gradients;
  std::vector<double> hessians;
  double gradient_sum = 0;
  double hessian_sum = 0;
  double gradient_error = 0;
  double hessian_error = 0;
  Errors errors;
  RayCounters counters;
  uint32_t index = 0;
  for (const Sample& point : points) {
    RandomStream random(7, index++, 0, 0);
    RadianceJet sum;
    gather.add(point.x, world.medium_at(point.x), random, sum, counters);
    const Jet3d jet = sum.channels[0] * (1.0 / radiance_red);
    const double gradient = glm::length(point.reference.gradient);
    const double hessian = point.reference.hessian.norm();
    gradients.push_back(glm::length(jet.gradient - point.reference.gradient) / gradient);
    hessians.push_back((jet.hessian - point.reference.hessian).norm() / hessian);
    gradient_sum += gradient;
    hessian_sum += hessian;
    gradient_error += gradients.back() * gradient;
    hessian_error += hessians.back() * hessian;
    errors.bias += (jet.value / point.reference.value - 1) / static_cast<double>(points.size());
  }
  errors.gradient_mean = gradient_error / gradient_sum;
  errors.hessian_mean = hessian_error / hessian_sum;
  errors.gradient_median = median(gradients);
  errors.hessian_median = median(hessians);
  errors.rays = static_cast<double>(counters.total()) / static_cast<double>(points.size());
  return errors;
}

class Penumbra : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scene::prepare_render_thread();
    world_ = std::make_unique<transport::World>(
        scene::load_scene("penumbra.xml", scene::folder_source("scenes/penumbra"), {}));
    const test::PenumbraReference reference = test::PenumbraReference::of_scene(0.3);
    lit_ = points_of_zone(reference, 1, 1, 100);
    penumbra_ = points_of_zone(reference, 0.01, 0.99, 200);
    umbra_ = points_of_zone(reference, 0, 0, 100);
  }
  static void TearDownTestSuite() { world_.reset(); }

  static std::unique_ptr<transport::World> world_;
  static std::vector<Sample> lit_;
  static std::vector<Sample> penumbra_;
  static std::vector<Sample> umbra_;
};
std::unique_ptr<transport::World> Penumbra::world_;
std::vector<Sample> Penumbra::lit_;
std::vector<Sample> Penumbra::penumbra_;
std::vector<Sample> Penumbra::umbra_;

EstimatorSettings with_terms(bool terms) {
  EstimatorSettings settings;
  settings.sliding = terms;
  settings.corners = terms;
  return settings;
}

// Bounds are those the method was measured to reach (method.md sections 6.4 and 7) for 8 x 8 cells.
TEST_F(Penumbra, GradientOfThePenumbra) {
  const Errors errors = errors_of(*world_, with_terms(false), penumbra_);
  EXPECT_LE(errors.gradient_mean, 0.02);
  EXPECT_LE(errors.gradient_median, 0.02);
  EXPECT_NEAR(errors.bias, 0, 0.005);
}

TEST_F(Penumbra, OptionalTermsMakeTheHessianConverge) {
  const Errors errors = errors_of(*world_, with_terms(true), penumbra_);
  EXPECT_LE(errors.hessian_mean, 0.04);
  EXPECT_LE(errors.hessian_median, 0.03);
}

TEST_F(Penumbra, LitZone) {
  const Errors errors = errors_of(*world_, with_terms(false), lit_);
  EXPECT_LE(errors.gradient_mean, 0.003);
  EXPECT_LE(errors.hessian_mean, 0.003);
  EXPECT_NEAR(errors.bias, 0, 0.002);
}

TEST_F(Penumbra, UmbraIsExactlyBlack) {
  const LightGather gather(*world_, with_terms(true));
  RayCounters counters;
  for (const Sample& point : umbra_) {
    RandomStream random(7, 0, 0, 0);
    RadianceJet sum;
    gather.add(point.x, world_->medium_at(point.x), random, sum, counters);
    const Jet3d jet = sum.luminance();
    EXPECT_EQ(jet.value, 0);
    EXPECT_EQ(glm::length(jet.gradient), 0);
    EXPECT_EQ(jet.hessian.norm(), 0);
  }
}

}  // namespace
}  // namespace fogbank::derivatives
