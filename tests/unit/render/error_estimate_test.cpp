#include "render/error_estimate.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "function_integrator.h"

namespace fogbank::render {
namespace {

std::shared_ptr<ReferenceImage> grey(int32_t width, int32_t height, float value) {
  auto reference = std::make_shared<ReferenceImage>();
  reference->window = {0, 0, width, height};
  reference->rgb.assign(static_cast<size_t>(width) * static_cast<size_t>(height) * 3, value);
  return reference;
}

TrueError true_error(RenderSettings settings, std::shared_ptr<const ReferenceImage> reference, float value) {
  settings.reference = std::move(reference);
  RenderJob job(
      function_integrator([value](const Ray&, RandomStream&, RayCounters&) { return Spectrum(value); }),
      settings);
  run_to_completion(job, 2);
  EXPECT_TRUE(job.history().back().estimate.true_error.has_value());
  return *job.progress().estimate.true_error;
}

TEST(TrueError, OfAnEvenPicture) {
  const TrueError error = true_error(small_settings(37, 21, 2), grey(37, 21, 0.5f), 0.75f);
  // Floats: 1e-6.
  EXPECT_NEAR(error.relative_mse, 0.25 * 0.25 / (0.25 + 0.01), 1e-6);
  EXPECT_NEAR(error.relative_error, 0.25 / 0.55, 1e-6);
  EXPECT_NEAR(error.median, 0.25 / 0.55, 1e-6);
  EXPECT_NEAR(error.percentile_99, 0.25 / 0.55, 1e-6);
  const TrueError none = true_error(small_settings(37, 21, 2), grey(37, 21, 0.5f), 0.5f);
  EXPECT_EQ(none.relative_mse, 0.0);
  EXPECT_EQ(none.percentile_99, 0.0);
}

TEST(TrueError, BlackPicturesHaveNumbers) {
  const TrueError black = true_error(small_settings(16, 16, 1), grey(16, 16, 0), 0);
  EXPECT_EQ(black.relative_error, 0.0);
  const TrueError lit = true_error(small_settings(16, 16, 1), grey(16, 16, 0), 1);
  EXPECT_TRUE(std::isfinite(lit.relative_error) && std::isfinite(lit.relative_mse));
  EXPECT_NEAR(lit.relative_mse, 100, 1e-3);
}

// One bright pixel of the reference: its neighbours' denominators see it, and the worst pixel is left out.
TEST(TrueError, DenominatorsAreMeansAround) {
  const auto reference = grey(50, 40, 0.1f);
  const size_t bright = (20 * 50 + 30) * 3;
  for (size_t c = 0; c < 3; ++c) reference->rgb[bright + c] = 2.6f;
  const TrueError error = true_error(small_settings(50, 40, 1), reference, 0.2f);
  // 2000 pixels: the two worst are left out, the bright one (2.4^2 / 0.05) and one of the others.
  const double plain = 0.01 / (0.01 + 0.01);
  const double near = 0.01 / (0.2 * 0.2 + 0.01);  // (24 * 0.1 + 2.6) / 25 = 0.2
  EXPECT_NEAR(error.relative_mse, (24 * near + (2000 - 25 - 1) * plain) / 1998, 1e-6);
}

TEST(TrueError, TilesMatter) {
  // A gradient seen through tiles of any size: pixels are found where they are.
  auto reference = std::make_shared<ReferenceImage>();
  reference->window = {3, 2, 41, 27};
  const auto pixel = [](const Ray& ray, RandomStream&, RayCounters&) { return glm::abs(ray.direction); };
  RenderSettings settings = small_settings(60, 40, 1);
  settings.film.crop = reference->window;
  reference->rgb = render_function(settings, 1, pixel).rgb;
  settings.reference = reference;
  for (const int32_t size : {8, 16, 128}) {
    settings.tile_size = size;
    RenderJob job(function_integrator(pixel), settings);
    run_to_completion(job, 2);
    // The film has doubles, the reference floats.
    EXPECT_LT(job.progress().estimate.true_error->percentile_99, 1e-6);
  }
}

TEST(TrueError, ReferencesAreChecked) {
  RenderSettings settings = small_settings(16, 16, 1);
  const auto expect_refused = [&](std::shared_ptr<ReferenceImage> reference) {
    settings.reference = std::move(reference);
    EXPECT_THROW(validate(settings), Error);
  };
  expect_refused(grey(16, 15, 1));
  expect_refused(grey(16, 16, std::nanf("")));
  expect_refused(grey(16, 16, -1));
  auto short_one = grey(16, 16, 1);
  short_one->rgb.pop_back();
  expect_refused(std::move(short_one));
}

TEST(RelativeBias, FollowsItsFormula) {
  class Biased final : public integrators::Integrator {
   public:
    integrators::PixelSample sample(const Ray&, RandomStream&, RayCounters&) const override {
      return {.sampled = Spectrum(0.5f), .cached = Spectrum(0)};
    }
    integrators::CacheView cache_view(const Ray&, RandomStream&, RayCounters&) const override {
      return {.radius = 0, .record_density = 0, .rejected = 0, .variance = 0.0016f, .bias = 0.03f};
    }
  };
  const RenderSettings settings = small_settings(50, 30, 1);
  CacheSurvey survey(settings.film.crop, 7, {Aov::variance, Aov::bias});
  EXPECT_EQ(survey.columns(), 7u);
  EXPECT_EQ(survey.rows(), 4u);
  const Biased integrator;
  class Camera final : public integrators::CameraRays {
   public:
    Ray sample(uint32_t, uint32_t, RandomStream&) const override { return {}; }
    scene::Window window() const override { return {}; }
    Vec2i film_size() const override { return {}; }
    Vec3f position() const override { return Vec3f(0); }
    float pixel_angle() const override { return 0; }
  };
  const Camera camera;
  RayCounters counters;
  for (uint32_t row = 0; row < survey.rows(); ++row)
    survey.set_row(row, survey.look(row, integrator, camera, 0, counters));

  const TileGrid grid(settings.film.crop, 128);
  TileFilm film;
  film.samples = 1;
  film.sampled.resize(50 * 30);
  for (PixelSums& sums : film.sampled) sums.add(0, Spectrum(0.5f));
  const std::vector<const TileFilm*> tiles{&film};
  // sqrt(0.03^2 + 0.04^2) = 0.05, over 0.5 + 0.05.
  EXPECT_NEAR(relative_bias({grid, tiles}, settings.film.crop, survey), 0.05 / 0.55, 1e-6);
}

TEST(CacheSurvey, OfTheSmallestWindow) {
  const CacheSurvey survey({5, 6, 1, 1}, 9, {Aov::radius});
  EXPECT_EQ(survey.rows(), 1u);
  EXPECT_EQ(survey.columns(), 1u);
  EXPECT_EQ(survey.x(0), 5);
  EXPECT_EQ(survey.y(0), 6);
}

}  // namespace
}  // namespace fogbank::render
