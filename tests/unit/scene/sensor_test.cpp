// Reconstruction filters and fields of view.
#include "scene/sensor.h"

#include <gtest/gtest.h>

#include <cmath>

namespace fogbank::scene::test {
namespace {

Film film_with(ReconstructionFilter filter, float radius, float stddev = 0.5f) {
  Film film;
  film.filter = filter;
  film.filter_radius = radius;
  film.filter_stddev = stddev;
  return film;
}

/// Second moment of the offsets in x over a regular grid of canonical numbers: integrates the inverse
/// distribution by the midpoint rule.
double second_moment(const Film& film) {
  constexpr int count = 100000;
  double sum = 0;
  for (int i = 0; i < count; ++i) {
    const float u = (static_cast<float>(i) + 0.5f) / count;
    const Vec2f offset = sample_filter_offset(film, {u, 0.5f});
    EXPECT_LE(std::fabs(offset.x), film.filter_radius * (1 + 1e-6f));
    EXPECT_NEAR(offset.y, 0.0f, 1e-6f);
    sum += static_cast<double>(offset.x) * offset.x;
  }
  return sum / count;
}

TEST(ReconstructionFilters, SecondMoments) {
  // Midpoint rule with 1e5 points on bounded, monotonic functions, in single precision: 1e-5 relative.
  EXPECT_NEAR(second_moment(film_with(ReconstructionFilter::box, 0.5f)), 1.0 / 12, 1e-6);
  EXPECT_NEAR(second_moment(film_with(ReconstructionFilter::box, 1.5f)), 9.0 / 12, 1e-5);
  EXPECT_NEAR(second_moment(film_with(ReconstructionFilter::tent, 1.0f)), 1.0 / 6, 2e-6);
  // exp(-x^2/2) - exp(-8) on [-4, 4]: integrals sqrt(2 pi) erf(4/sqrt 2) - 8 e and, for x^2 times it,
  // sqrt(2 pi) erf(4/sqrt 2) - 8 e - 128/3 e with e = exp(-8).
  const double e = std::exp(-8.0);
  const double gauss = std::sqrt(2 * 3.14159265358979323846) * std::erf(4 / std::sqrt(2.0));
  const double variance = (gauss - 8 * e - 128.0 / 3 * e) / (gauss - 8 * e);
  EXPECT_NEAR(second_moment(film_with(ReconstructionFilter::gaussian, 2.0f, 0.5f)), 0.25 * variance, 1e-5);
  EXPECT_NEAR(second_moment(film_with(ReconstructionFilter::gaussian, 4.0f, 1.0f)), variance, 4e-5);
}

TEST(ReconstructionFilters, ExtremeNumbersStayInside) {
  for (const auto filter :
       {ReconstructionFilter::box, ReconstructionFilter::tent, ReconstructionFilter::gaussian})
    for (const float u : {0.0f, 0x1p-24f, 0.5f, one_minus_epsilon}) {
      const Film film = film_with(filter, 2.0f);
      const Vec2f offset = sample_filter_offset(film, {u, u});
      EXPECT_TRUE(std::isfinite(offset.x));
      EXPECT_LE(std::fabs(offset.x), 2.0f);
    }
}

/// Horizontal field of view of 40 degrees along `axis`.
double fov_x(FovAxis axis, int32_t width, int32_t height) {
  Sensor sensor;
  sensor.fov_degrees = 40;
  sensor.fov_axis = axis;
  Film film;
  film.width = width;
  film.height = height;
  return sensor.fov_x_degrees(film);
}

TEST(HorizontalFov, EveryAxis) {
  EXPECT_NEAR(fov_x(FovAxis::x, 96, 64), 40, 1e-12);
  EXPECT_NEAR(fov_x(FovAxis::larger, 96, 64), 40, 1e-12);
  EXPECT_NEAR(fov_x(FovAxis::smaller, 48, 64), 40, 1e-12);
  const double degree = 3.14159265358979323846 / 180;
  EXPECT_NEAR(std::tan(fov_x(FovAxis::y, 96, 64) * degree / 2), 1.5 * std::tan(20 * degree), 1e-12);
  EXPECT_NEAR(fov_x(FovAxis::smaller, 96, 64), fov_x(FovAxis::y, 96, 64), 1e-12);
  EXPECT_NEAR(fov_x(FovAxis::larger, 48, 64), fov_x(FovAxis::y, 48, 64), 1e-12);
  // 3 : 4 : 5
  EXPECT_NEAR(std::tan(fov_x(FovAxis::diagonal, 64, 48) * degree / 2), 0.8 * std::tan(20 * degree), 1e-12);
}

}  // namespace
}  // namespace fogbank::scene::test
