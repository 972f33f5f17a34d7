// Look-ups on surfaces: flat extents, and records of other sides left out.
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "cache/extents.h"
#include "cache/index.h"

namespace fogbank::cache {
namespace {

const Vec3f up(0, 0, 1);

MetricSettings settings() {
  MetricSettings result;
  result.threshold = 1e-3;
  result.radiance_floor = 0.05;
  result.maximum_radius = 1;
  return result;
}

Record surface_record(const Vec3f& position, const Vec3f& normal, float radiance) {
  Record record;
  record.position = position;
  record.normal = normal;
  record.component.quantity = Quantity::irradiance;
  record.radiance = Spectrum(radiance);
  record.id = content_id(position, record.component, "surface", 0) ^ (normal.z < 0 ? 1u : 0u);
  return record;
}

Epoch epoch_of(std::vector<Record> records, const MetricSettings& metric = settings()) {
  return {std::make_shared<const RecordSet>(std::move(records)), metric};
}

Interpolation look_up(const Epoch& epoch, const Vec3f& point, const Vec3f& normal) {
  return epoch.find({0, 0, 0, Quantity::irradiance})->look_up(point, normal);
}

TEST(SurfaceLookup, LinearFieldAlongTheSurfaceIsReproduced) {
  std::vector<Record> records;
  for (int i = 0; i < 5; ++i)
    for (int j = 0; j < 5; ++j) {
      const Vec3f position(0.4f * static_cast<float>(i), 0.4f * static_cast<float>(j), 0);
      Record record = surface_record(position, up, 1 + 0.25f * position.x - 0.125f * position.y);
      record.gradient.fill({0.25f, -0.125f, 0});
      records.push_back(record);
    }
  const Epoch epoch = epoch_of(records);
  for (const Vec2f& p : {Vec2f(0.1f, 0.2f), Vec2f(0.77f, 1.1f), Vec2f(1.4f, 0.3f)}) {
    const Interpolation found = look_up(epoch, Vec3f(p, 0), up);
    ASSERT_GT(found.weight, 0);
    EXPECT_NEAR(found.radiance.x, 1 + 0.25f * p.x - 0.125f * p.y, 1e-5f);
  }
}

TEST(SurfaceLookup, SidesOfAThinWallNeverMix) {
  // A wall a thousandth of the extents thick.
  const Epoch epoch =
      epoch_of({surface_record(Vec3f(0), up, 1), surface_record(Vec3f(0, 0, -0.001f), -up, 100)});
  EXPECT_FLOAT_EQ(look_up(epoch, Vec3f(0.1f, 0, 0), up).radiance.x, 1);
  EXPECT_FLOAT_EQ(look_up(epoch, Vec3f(0.1f, 0, -0.001f), -up).radiance.x, 100);
}

TEST(SurfaceLookup, WallsOfACornerAndStepsDontCount) {
  const Epoch epoch = epoch_of({surface_record(Vec3f(0), up, 1)});
  EXPECT_GT(look_up(epoch, Vec3f(0.5f, 0, 0), up).weight, 0);
  EXPECT_EQ(look_up(epoch, Vec3f(0.5f, 0, 0), Vec3f(-1, 0, 0)).weight, 0);
  // Extents are of radius 1 at most.
  EXPECT_EQ(look_up(epoch, Vec3f(0.1f, 0, 1.01f * surface_thickness), up).weight, 0);
  EXPECT_EQ(look_up(epoch, Vec3f(0.1f, 0, -1.01f * surface_thickness), up).weight, 0);
}

TEST(SurfaceLookup, WeightFallsWithTheAngleBetweenNormals) {
  const Epoch epoch = epoch_of({surface_record(Vec3f(0), up, 1)});
  float last = 2;
  for (int degrees = 0; degrees <= 25; degrees += 5) {
    const float angle = static_cast<float>(degrees) * pi / 180;
    const float weight = look_up(epoch, Vec3f(0), Vec3f(std::sin(angle), 0, std::cos(angle))).weight;
    EXPECT_LT(weight, last);
    EXPECT_GT(weight, 0);
    last = weight;
  }
  EXPECT_EQ(look_up(epoch, Vec3f(0), Vec3f(0.5f, 0, std::sqrt(0.75f))).weight, 0);
}

TEST(SurfaceLookup, SurfacesInBetweenHideARecord) {
  Record record = surface_record(Vec3f(0), up, 1);
  record.depth.insert(Vec3f(1, 0, 0), 0.3f);
  const Epoch epoch = epoch_of({record});
  EXPECT_EQ(look_up(epoch, Vec3f(0.5f, 0, 0), up).weight, 0);
  EXPECT_EQ(look_up(epoch, Vec3f(0.5f, 0, 0), up).rejected, 1u);
  EXPECT_GT(look_up(epoch, Vec3f(-0.5f, 0, 0), up).weight, 0);
}

TEST(SurfaceLookup, RadiusIsThatAlongTheSurface) {
  const Epoch epoch = epoch_of({surface_record(Vec3f(0), up, 1)});
  EXPECT_FLOAT_EQ(look_up(epoch, Vec3f(0.1f, 0, 0), up).radius, 1);
  EXPECT_FLOAT_EQ(epoch.find({0, 0, 0, Quantity::irradiance})->radius(0), 1);
}

TEST(SurfaceMetric, ExtentHoldsTheThresholdInThePlane) {
  Place place;
  place.normal = glm::normalize(Vec3f(1, 2, 3));
  place.radiance = Spectrum(2);
  place.visibility_margin = infinity;
  const Vec3f a = glm::normalize(Vec3f(2, -1, 0));
  const Vec3f b = glm::cross(place.normal, a);
  // What the Hessian says across the surface is of no concern.
  place.hessian = Symmetric3f::outer(a) * 40.0f + Symmetric3f::outer(b) * -10.0f +
                  Symmetric3f::outer(place.normal) * 1000.0f;
  MetricSettings metric = settings();
  metric.threshold = 1e-3;
  const Ellipsoid ellipsoid = base_ellipsoid(metric, place);
  EXPECT_NEAR(std::fabs(glm::dot(ellipsoid.axes[2], place.normal)), 1, 1e-6f);
  EXPECT_FLOAT_EQ(ellipsoid.semi_axes[2],
                  surface_thickness * std::min(ellipsoid.semi_axes[0], ellipsoid.semi_axes[1]));
  const bool first_is_a = std::fabs(glm::dot(ellipsoid.axes[0], a)) > 0.5f;
  const double along_a = static_cast<double>(ellipsoid.semi_axes[first_is_a ? 0 : 1]);
  const double along_b = static_cast<double>(ellipsoid.semi_axes[first_is_a ? 1 : 0]);
  EXPECT_NEAR(along_b / along_a, 2, 1e-4);
  EXPECT_NEAR(error_integral<2>({40, 10}, {along_a, along_b}) / (2 * surface_threshold(metric)), 1, 1e-5);
}

TEST(SurfaceMetric, ThresholdsAdmitTheSameErrorAtTheBorder) {
  // Of a disk and a ball of 0.4 maximum_radius with one eigenvalue: lambda R^2 / 2.
  const MetricSettings metric = settings();
  const double radius = 0.4 * metric.maximum_radius;
  const double lambda = 15 * metric.threshold / (2 * 3.14159265358979323846 * std::pow(radius, 5));
  EXPECT_NEAR(ball_radius<3>({lambda, 0, 0}, metric.threshold), radius, 1e-12);
  EXPECT_NEAR(ball_radius<2>({lambda, 0}, surface_threshold(metric)), radius, 1e-12);
}

TEST(SurfaceMetric, OnlySimilarNormalsContradict) {
  // Two records close together, one ten times as bright: on one plane each shrinks the other's extent, on two
  // sides of a wall they have nothing to say about each other.
  for (const bool same_side : {true, false}) {
    const RecordSet set(
        {surface_record(Vec3f(0), up, 1), surface_record(Vec3f(0.3f, 0, -0.001f), same_side ? up : -up, 10)});
    const std::vector<Ellipsoid> ellipsoids = guarded_ellipsoids(set, set.components()[0], settings());
    for (const Ellipsoid& ellipsoid : ellipsoids) {
      if (same_side)
        EXPECT_LT(ellipsoid.longest(), 0.31f);
      else
        EXPECT_FLOAT_EQ(ellipsoid.longest(), 1);
    }
  }
}

}  // namespace
}  // namespace fogbank::cache
