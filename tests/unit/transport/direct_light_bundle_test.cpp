// Samples taken together have the mean of samples taken one by one, and less variance.
#include "transport/direct_light_bundle.h"

#include <gtest/gtest.h>

#include <cmath>

#include "transport/world_builders.h"

namespace fogbank::transport {
namespace {

using test::parse_world;

/// Coloured fog with a plate that shadows half of three lights: one with an area, one of parallel light from
/// outside the fog, one of an environment.
const char* const scene_text = R"(
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.3, 0.4, 0.6"/><rgb name="albedo" value="0.9, 0.7, 0.8"/>
    <phase type="hg"><float name="g" value="0.4"/></phase>
  </medium>
  <sensor type="perspective"><ref name="medium" id="fog"/></sensor>
  <shape type="cube"><transform name="to_world"><scale value="4"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="0.8"/></transform>
    <bsdf type="twosided"><bsdf type="plastic"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.5"/><translate x="0.5" y="1.5"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 6, 4"/></emitter></shape>
  <emitter type="directional"><vector name="direction" value="0.4, -1, 0.2"/><rgb name="irradiance" value="3, 2, 1"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.1, 0.2, 0.3"/></emitter>)";

struct Mean {
  Vec3d sum{0};
  Vec3d squares{0};
  double count = 0;

  void add(const Spectrum& sample) {
    sum += Vec3d(sample);
    squares += Vec3d(sample) * Vec3d(sample);
    ++count;
  }
  Vec3d mean() const { return sum / count; }
  /// Of the mean.
  Vec3d variance() const { return (squares / count - mean() * mean()) / count; }
};

void expect_same_mean_and_less_variance(const Mean& single, const Mean& bundle, int32_t samples) {
  for (int c = 0; c < 3; ++c) {
    // Bundles of different pixels are independent; 4.5 standard errors, one in 1e5 by chance.
    EXPECT_NEAR(bundle.mean()[c], single.mean()[c],
                4.5 * std::sqrt(bundle.variance()[c] + single.variance()[c]))
        << c;
    EXPECT_LT(bundle.variance()[c] * bundle.count * samples, single.variance()[c] * single.count) << c;
  }
}

TEST(DirectLightBundle, SegmentsAgreeWithSingleSamples) {
  const auto world = parse_world(scene_text);
  const int32_t medium = world->scene().sensor.medium;
  RayCounters counters;
  constexpr int32_t samples = 16;
  for (const Vec3f& direction : {Vec3f(1, 0, 0), glm::normalize(Vec3f(1, 0.3f, -0.2f))}) {
    const MediumSegment segment{{-2, -0.5f, 0.1f}, direction, 4, &world->medium(medium)};
    Mean single;
    Mean bundle;
    for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
      RandomStream random(1, pixel, 0, pixel % 3);
      single.add(in_scattered_radiance(*world, segment, medium, 1, EmissionFoundBy::light_sampling, random,
                                       counters));
      if (pixel < 4000)
        bundle.add(in_scattered_radiance_bundle(*world, segment, medium, LightSubset::all, samples, random,
                                                counters));
    }
    expect_same_mean_and_less_variance(single, bundle, samples);
  }
}

TEST(DirectLightBundle, SurfacesAgreeWithSingleSamples) {
  const auto world = parse_world(scene_text);
  const int32_t medium = world->scene().sensor.medium;
  RayCounters counters;
  constexpr int32_t samples = 8;
  const Vec3f direction = glm::normalize(Vec3f(0.3f, -1, 0.4f));
  const Ray ray{Vec3f(0.2f, 0, 0.1f) - direction, direction, infinity};
  scene::Hit hit;
  ASSERT_TRUE(world->scene().intersector->intersect(ray, hit));
  const scene::SurfaceInteraction surface = world->scene().interaction(ray, hit);
  for (const EmissionFoundBy found_by :
       {EmissionFoundBy::light_sampling, EmissionFoundBy::light_and_path_sampling}) {
    Mean single;
    Mean bundle;
    for (uint32_t pixel = 0; pixel < 20000; ++pixel) {
      RandomStream random(2, pixel, 0, 5);
      single.add(reflected_direct_light(*world, surface, direction, medium, found_by, random, counters));
      if (pixel < 4000)
        bundle.add(reflected_direct_light_bundle(*world, surface, direction, medium, samples, found_by,
                                                 random, counters));
    }
    if (found_by == EmissionFoundBy::light_sampling) {
      expect_same_mean_and_less_variance(single, bundle, samples);
    } else {
      // The share of the lights grows with their samples: up to what they bring alone.
      for (int c = 0; c < 3; ++c)
        EXPECT_GE(bundle.mean()[c], single.mean()[c] - 4.5 * std::sqrt(single.variance()[c]));
    }
  }
}

TEST(DirectLightBundle, SamplesOfAPixelContinueItsSequence) {
  // Sixteen bundles of a pixel err less than as many bundles of different pixels.
  const auto world = parse_world(scene_text);
  const int32_t medium = world->scene().sensor.medium;
  RayCounters counters;
  const MediumSegment segment{{-2, -0.5f, 0.1f}, {1, 0, 0}, 4, &world->medium(medium)};
  Mean together;
  Mean apart;
  for (uint32_t pixel = 0; pixel < 500; ++pixel) {
    Spectrum sum_together(0);
    Spectrum sum_apart(0);
    for (uint32_t sample = 0; sample < 16; ++sample) {
      RandomStream same(3, pixel, 0, sample);
      sum_together +=
          in_scattered_radiance_bundle(*world, segment, medium, LightSubset::all, 4, same, counters) / 16.0f;
      RandomStream other(3, pixel * 16 + sample, 1, sample);
      sum_apart +=
          in_scattered_radiance_bundle(*world, segment, medium, LightSubset::all, 4, other, counters) / 16.0f;
    }
    together.add(sum_together);
    apart.add(sum_apart);
  }
  for (int c = 0; c < 3; ++c) EXPECT_LT(together.variance()[c], 0.7 * apart.variance()[c]) << c;
}

}  // namespace
}  // namespace fogbank::transport
