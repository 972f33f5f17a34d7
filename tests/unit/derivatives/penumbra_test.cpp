// Direct light and its derivatives in scenes/penumbra, against quadrature over what the plates leave of the
// light.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "core/random.h"
#include "derivatives/light_gather.h"
#include "derivatives/penumbra_reference.h"
#include "derivatives/plan_request.h"
#include "scene/loader.h"

namespace fogbank::derivatives {
namespace {

constexpr float radiance_red = 26;

struct Sample {
  Vec3f x;
  Jet3d reference;  ///< for unit radiance
};

/// Points of one zone, by the share of the light that they see, where finite differences are reliable.
std::vector<Sample> points_of_zone(
    const test::PenumbraReference& reference, double least, double most, size_t count,
    const std::function<bool(const Vec3f&)>& wanted = [](const Vec3f&) { return true; }) {
  std::vector<Sample> points;
  for (uint32_t i = 0; points.size() < count; ++i) {
    RandomStream random(11, i, 0, 0);
    const Vec3f x(4 * random.next_float() - 2, 3 * random.next_float() - 1.5f,
                  2.4f * random.next_float() - 0.9f);
    if (!wanted(x)) continue;
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
  const transport::Plan plan(world, plan_request(settings));
  const LightGather gather(world, plan, settings);
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
    // Of the upper plate's outline only the edge at x = 0.1 is seen before the light, and the lower plate is
    // not; where the light is cut in its inner four fifths.
    one_edge_ = points_of_zone(reference, 0.1, 0.9, 100, [](const Vec3f& x) {
      const float t = (1.995f - x.z) / (1 - x.z);
      const float lower_edge = x.x + (0.6f - x.x) * (1.995f - x.z) / (0.3f - x.z);
      return x.z < 0.6f && x.y + (0.8f - x.y) * t > 0.5f && x.y - (0.8f + x.y) * t < -0.5f &&
             x.x - (1.2f + x.x) * t < -0.5f && (x.z > 0.3f || lower_edge > 0.5f);
    });
  }
  static void TearDownTestSuite() { world_.reset(); }

  static std::unique_ptr<transport::World> world_;
  static std::vector<Sample> lit_;
  static std::vector<Sample> penumbra_;
  static std::vector<Sample> umbra_;
  static std::vector<Sample> one_edge_;
};
std::unique_ptr<transport::World> Penumbra::world_;
std::vector<Sample> Penumbra::lit_;
std::vector<Sample> Penumbra::penumbra_;
std::vector<Sample> Penumbra::umbra_;
std::vector<Sample> Penumbra::one_edge_;

EstimatorSettings settings_of(bool bisect, bool terms, int32_t cells = 8) {
  EstimatorSettings settings;
  settings.samples = 16 * cells * cells;
  settings.bisect = bisect;
  settings.sliding = terms;
  settings.corners = terms;
  return settings;
}

// Bounds on the means are some twice what was measured, and never above what method.md sections 6.4 and 7
// promise for as many cells. Measured with 8 x 8 cells: gradient 0.10 %, Hessian 37 % (median 19 %), with the
// optional terms 2.1 % (0.7 %).
TEST_F(Penumbra, Gradient) {
  const Errors errors = errors_of(*world_, settings_of(true, false), penumbra_);
  EXPECT_LE(errors.gradient_mean, 0.003);
  EXPECT_LE(errors.gradient_median, 0.003);
  EXPECT_NEAR(errors.bias, 0, 0.002);
  const Errors coarse = errors_of(*world_, settings_of(true, false, 4), penumbra_);
  EXPECT_LE(coarse.gradient_mean, 0.01);
  EXPECT_NEAR(coarse.bias, 0, 0.01);
}

TEST_F(Penumbra, OptionalTermsMakeTheHessianConverge) {
  const Errors errors = errors_of(*world_, settings_of(true, true), penumbra_);
  EXPECT_LE(errors.hessian_mean, 0.03);
  EXPECT_LE(errors.hessian_median, 0.015);
}

// Method.md section 6.4 without its terms: it was measured where one edge alone cuts the light, at a
// distance.
TEST_F(Penumbra, HessianWithoutTheTermsWhereOneEdgeCutsTheLight) {
  const Errors errors = errors_of(*world_, settings_of(true, false), one_edge_);
  EXPECT_LE(errors.hessian_mean, 0.16);
  EXPECT_LE(errors.hessian_median, 0.16);
  const Errors with_terms = errors_of(*world_, settings_of(true, true), one_edge_);
  EXPECT_LE(with_terms.hessian_mean, 0.01);
}

TEST_F(Penumbra, WithoutBisection) {
  const Errors errors = errors_of(*world_, settings_of(false, false), penumbra_);
  EXPECT_LE(errors.gradient_mean, 0.2);
  EXPECT_NEAR(errors.bias, 0, 0.06);
  // First order in the cells' width.
  const Errors fine = errors_of(*world_, settings_of(false, false, 16), penumbra_);
  EXPECT_LE(fine.gradient_mean, 0.1);
}

TEST_F(Penumbra, LitZone) {
  const Errors errors = errors_of(*world_, settings_of(true, true), lit_);
  EXPECT_LE(errors.gradient_mean, 0.001);
  EXPECT_LE(errors.hessian_mean, 0.0015);
  EXPECT_NEAR(errors.bias, 0, 0.001);
}

TEST_F(Penumbra, UmbraIsExactlyBlack) {
  const EstimatorSettings settings = settings_of(true, true);
  const transport::Plan plan(*world_, plan_request(settings));
  const LightGather gather(*world_, plan, settings);
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

// What isn't asked for isn't computed, and what is asked for doesn't depend on it.
TEST_F(Penumbra, OrdersAgree) {
  EstimatorSettings settings = settings_of(true, true);
  const transport::Plan plan(*world_, plan_request(settings));
  for (const Sample& point : penumbra_) {
    std::array<RadianceJet, 3> jets;
    std::array<uint64_t, 3> rays{};
    for (const DerivativeOrder order :
         {DerivativeOrder::value, DerivativeOrder::gradient, DerivativeOrder::hessian}) {
      const auto index = static_cast<size_t>(order);
      settings.derivatives = order;
      const LightGather gather(*world_, plan, settings);
      RandomStream random(7, 0, 0, 0);
      RayCounters counters;
      gather.add(point.x, world_->medium_at(point.x), random, jets[index], counters);
      rays[index] = counters.total();
    }
    EXPECT_NEAR(jets[0].channels[0].value, jets[2].channels[0].value, 1e-12 * jets[2].channels[0].value);
    EXPECT_EQ(jets[1].channels[0].value, jets[2].channels[0].value);
    EXPECT_EQ(jets[1].channels[0].gradient, jets[2].channels[0].gradient);
    EXPECT_LT(rays[0], rays[2]);
  }
}

}  // namespace
}  // namespace fogbank::derivatives
