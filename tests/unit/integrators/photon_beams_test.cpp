#include "integrators/photon_beams.h"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <set>

#include "integrators/photon_beam_grid.h"
#include "integrators/picture.h"
#include "transport/world_builders.h"

namespace fogbank::integrators {
namespace {

using test::TestCamera;
using transport::PhotonBeam;

constexpr const char* sensor = R"(
  <sensor type="perspective">
    <float name="fov" value="60"/>
    <transform name="to_world"><lookat origin="0, -1.8, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <ref name="medium" id="fog"/>
  </sensor>)";

std::string fog(const std::string& sigma_t, const std::string& albedo,
                const std::string& phase = "isotropic") {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value=")" + sigma_t +
         R"("/><rgb name="albedo" value=")" + albedo + R"("/><phase type=")" + phase + R"(">)" +
         (phase == "hg" ? R"(<float name="g" value="0.6"/>)" : "") + "</phase></medium>" + sensor;
}

/// Walls of a room of 4 x 4 x 2; fog fills it as it fills all space.
const std::string walls = R"(
  <bsdf type="twosided" id="wall"><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></bsdf>
  <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="1"/></transform><ref id="wall"/></shape>)";

std::string plate(const std::string& bsdf) {
  return R"(<shape type="rectangle"><transform name="to_world"><scale value="0.5"/></transform>)" + bsdf +
         "</shape>";
}
const std::string diffuse_plate = plate(
    R"(<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.2, 0.5, 0.8"/></bsdf></bsdf>)");
const std::string rough_plate = plate(
    R"(<bsdf type="twosided"><bsdf type="roughconductor"><float name="alpha" value="0.2"/></bsdf></bsdf>)");

/// A light below the ceiling, at whose penumbra's edge the plate lies.
const std::string area_light = R"(
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="180"/><scale value="0.4"/><translate x="0" y="0" z="0.99"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
    <emitter type="area"><rgb name="radiance" value="10, 9, 7"/></emitter>
  </shape>)";
const std::string point_light = R"(<emitter type="point"><point name="position" x="0.3" y="0.2" z="0.7"/>
  <rgb name="intensity" value="2, 3, 4"/></emitter>)";
const std::string spot_light = R"(<emitter type="spot"><float name="cutoff_angle" value="30"/>
  <transform name="to_world"><lookat origin="0.5, -1.2, 0.8" target="0, 0.3, -0.3" up="0, 0, 1"/></transform>
  <rgb name="intensity" value="4, 3, 2"/></emitter>)";
/// A ball of fog in empty space, so that light from infinity reaches it, over a plate.
std::string ball_of_fog(const std::string& light) {
  return R"(<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="2, 1.5, 1"/>
    <rgb name="albedo" value="0.9"/></medium>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0, -4, 0.5" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
  <shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="0" y="0" z="-1.1"/></transform>
    <bsdf type="diffuse"/></shape>)" +
         light;
}

/// Prepares a pass for sample number `sample`.
void prepare_sample(PhotonBeamsIntegrator& integrator, const CameraRays& camera, uint32_t sample,
                    int threads) {
  scene::prepare_render_thread();
  const std::unique_ptr<Preparation> preparation =
      integrator.prepare_pass(camera, {.seed = 0, .first = sample, .count = 1});
  while (const uint32_t tasks = preparation->next_round()) {
    test::run_tasks(tasks, threads, [&](uint32_t task) {
      RayCounters counters;
      preparation->run(task, counters);
    });
  }
}

/// Mean luminance of each quarter of a picture, with the variance of that mean.
struct Quarters {
  std::array<double, 4> mean{};
  std::array<double, 4> variance{};
};

/// Of `count` independent takes, each the sums over one sample of every pixel.
template <typename Prepare>
Quarters take(const Integrator& integrator, const TestCamera& camera, uint32_t first, uint32_t count,
              Prepare&& prepare) {
  Quarters result;
  const auto width = static_cast<uint32_t>(camera.film_size().x);
  const auto height = static_cast<uint32_t>(camera.film_size().y);
  std::array<double, 4> squares{};
  RayCounters counters;
  for (uint32_t sample = first; sample < first + count; ++sample) {
    prepare(sample);
    std::array<double, 4> sum{};
    for (uint32_t y = 0; y < height; ++y) {
      for (uint32_t x = 0; x < width; ++x) {
        RandomStream random(1, x, y, sample);
        const Ray ray = camera.sample(x, y, random);
        const Spectrum radiance = integrator.sample(ray, random, counters).sampled;
        EXPECT_TRUE(is_finite(radiance));
        sum[2 * (2 * y / height) + 2 * x / width] += static_cast<double>(luminance(radiance));
      }
    }
    for (size_t i = 0; i < 4; ++i) {
      const double mean = sum[i] / (0.25 * width * height);
      result.mean[i] += mean / count;
      squares[i] += mean * mean / count;
    }
  }
  for (size_t i = 0; i < 4; ++i)
    result.variance[i] = std::max(squares[i] - result.mean[i] * result.mean[i], 0.0) / (count - 1);
  return result;
}

struct SmallScene {
  std::string name;
  std::string body;
  int32_t max_depth = -1;
  uint32_t path_samples = 512;  ///< of volpath, a pixel
  bool hide_emitters = true;
};
std::ostream& operator<<(std::ostream& out, const SmallScene& scene) { return out << scene.name; }

class PhotonBeamsScenes : public testing::TestWithParam<SmallScene> {};

TEST_P(PhotonBeamsScenes, ConvergeToPathTracing) {
  const auto world = transport::test::parse_world(GetParam().body);
  const TestCamera camera(world->scene().sensor, 8, 8);
  IntegratorSettings settings;
  settings.max_depth = GetParam().max_depth;
  settings.hide_emitters = GetParam().hide_emitters;
  const auto reference = make_integrator("volpath", world, settings);
  const Quarters expected = take(*reference, camera, 0, GetParam().path_samples, [](uint32_t) {});

  PhotonBeamsIntegrator integrator(world, settings);
  const auto prepare = [&](uint32_t sample) { prepare_sample(integrator, camera, sample, 2); };
  constexpr uint32_t late_sample = 1000;
  const Quarters early = take(integrator, camera, 0, 32, prepare);
  const Quarters late = take(integrator, camera, late_sample, 64, prepare);
  // Bias of beams falls with the radius at least (at edges; elsewhere with its square), that of surfaces in
  // the mean over many pixels with the radius' square, which shrinks as the beams' radius does: so of what is
  // seen between two radii the smaller one has this share left at most.
  const double ratio = static_cast<double>(PhotonBeamsIntegrator::shrinking(late_sample).beams) /
                       static_cast<double>(PhotonBeamsIntegrator::shrinking(16).beams);
  const double share_left = ratio / (1 - ratio);
  for (size_t i = 0; i < 4; ++i) {
    // Four standard errors: 1 in 16000 by chance.
    const double noise = 4 * std::sqrt(expected.variance[i] + late.variance[i]);
    const double difference =
        std::fabs(early.mean[i] - late.mean[i]) + 4 * std::sqrt(early.variance[i] + late.variance[i]);
    EXPECT_NEAR(late.mean[i], expected.mean[i], noise + share_left * difference) << "quarter " << i;
    // The test can see something.
    EXPECT_LT(noise + share_left * difference, 0.35 * expected.mean[i]) << "quarter " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, PhotonBeamsScenes,
    testing::Values(
        SmallScene{"point", fog("0.5", "0.8") + walls + point_light},
        // Only here the light is seen: where a pixel shows its edge, that edge makes most of the noise.
        SmallScene{"visible_light", fog("0.5", "0.8") + walls + area_light, 3, 2048, false},
        SmallScene{"penumbra", fog("0.5", "0.8") + walls + area_light + diffuse_plate},
        SmallScene{"chromatic", fog("0.1, 0.5, 2", "0.9, 0.5, 0.7") + walls + point_light},
        SmallScene{"spot", fog("0.2", "0.8") + walls + spot_light},
        SmallScene{"forward", fog("0.4", "0.8", "hg") + walls + area_light},
        SmallScene{"rough", fog("0.3", "0.8") + walls + area_light + rough_plate},
        SmallScene{"directional",
                   ball_of_fog(R"(<emitter type="directional"><vector name="direction" value="1, 1, -1"/>
          <rgb name="irradiance" value="3"/></emitter>)")},
        SmallScene{"environment", ball_of_fog(R"(<emitter type="constant"/>)")},
        // Light that glass focuses: path tracing finds it by chance only, hence the samples.
        SmallScene{"caustic",
                   fog("0.3", "0.8") + walls + area_light +
                       R"(<shape type="sphere"><point name="center" x="0" y="0" z="0.4"/>
           <float name="radius" value="0.35"/><bsdf type="dielectric"/></shape>)",
                   -1, 2048}),
    [](const testing::TestParamInfo<SmallScene>& scene) { return scene.param.name; });

TEST(PhotonBeams, WhiteFurnaceIsWhite) {
  // Radiance 1 comes from everywhere and nothing absorbs: radiance is 1 everywhere, in fog, glass and on a
  // white bowl alike.
  const auto world = transport::test::parse_world(R"(
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1.5"/><rgb name="albedo" value="1"/></medium>
    <sensor type="perspective"><float name="fov" value="50"/>
      <transform name="to_world"><lookat origin="0, -4, 0.5" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
    <shape type="sphere"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="sphere"><point name="center" x="1.5" y="0" z="0"/><float name="radius" value="0.4"/>
      <bsdf type="dielectric"/></shape>
    <shape type="cylinder"><point name="p0" x="-1.5" y="0" z="-1"/><point name="p1" x="-1.5" y="0" z="0"/>
      <float name="radius" value="0.4"/>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf></shape>
    <emitter type="constant"/>)");
  const TestCamera camera(world->scene().sensor, 8, 8);
  PhotonBeamsIntegrator integrator(world, {});
  const Quarters found = take(integrator, camera, 500, 64,
                              [&](uint32_t sample) { prepare_sample(integrator, camera, sample, 2); });
  for (size_t i = 0; i < 4; ++i) {
    EXPECT_LT(std::sqrt(found.variance[i]), 0.03);
    EXPECT_NEAR(found.mean[i], 1, 4 * std::sqrt(found.variance[i])) << "quarter " << i;
  }
}

TEST(PhotonBeams, OneBeamScattersOnceAsTheClosedFormSays) {
  const auto world = transport::test::parse_world(fog("0.2, 0.7, 1.3", "0.9, 0.6, 0.3", "hg"));
  const PhotonGather gather(world, {});
  const PhotonBeam beam{.origin = Vec3f(-1, 0, 0),
                        .direction = Vec3f(1, 0, 0),
                        .length = 3,
                        .flux = Spectrum(1, 2, 3),
                        .medium = 0,
                        .depth = 0,
                        .path = 0};
  constexpr float radius = 0.1f;
  PhotonPass pass;
  pass.beams.emplace(std::vector<PhotonBeam>{beam}, radius);
  for (uint32_t part = 0; part < pass.beams->part_count(); ++part) pass.beams->build_part(part);

  // The camera looks along directions at 60 degrees to the beam, at heights across it; what it sees,
  // integrated over the height, is flux x transmittance x sigma_s x phase / sine, whatever the kernel.
  const double angle = 60 * static_cast<double>(pi) / 180;
  const Vec3f direction(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0);
  constexpr int steps = 400;
  constexpr double height_step = 0.25 / steps;
  Vec3d sum(0);
  RayCounters counters;
  for (int i = 0; i < steps; ++i) {
    const auto height = static_cast<float>((i + 0.5) * height_step - 0.125);
    RandomStream random(0, 0, 0, 0);
    // Meets the beam 1.5 from its begin, 2 from here.
    const Ray ray{Vec3f(0.5f, 0, height) - 2.0f * direction, direction, infinity};
    sum += Vec3d(gather.radiance(ray, pass, random, counters, nullptr).radiance) * height_step;
  }
  const transport::MediumInfo& medium = world->medium(0);
  const double g = 0.6;
  const double cosine = -std::cos(angle);  // light turns from the beam's direction to the camera's side
  const double phase =
      (1 - g * g) / (4 * static_cast<double>(pi) * std::pow(1 + g * g - 2 * g * cosine, 1.5));
  for (int channel = 0; channel < 3; ++channel) {
    const auto sigma_t = static_cast<double>(medium.sigma_t[channel]);
    // The beam stands for the share that got to 1.5 over the share of beams that are that long.
    const double along =
        std::exp(-(sigma_t - static_cast<double>(transport::PhotonTracer::end_rate(medium))) * 1.5);
    const double expected = static_cast<double>(beam.flux[channel]) * along * std::exp(-2 * sigma_t) *
                            static_cast<double>(medium.sigma_s[channel]) * phase / std::sin(angle);
    // Midpoint rule over a kernel with kinks at its ends: some 1e-5; floats.
    EXPECT_NEAR(sum[channel], expected, 1e-4 * expected) << channel;
  }
}

TEST(PhotonBeams, TheGridFindsWhatASearchOfAllBeamsFinds) {
  RandomStream random(3, 0, 0, 0);
  const auto point = [&] {
    return Vec3f(random.next_float(), random.next_float(), random.next_float()) * 4.0f - 2.0f;
  };
  std::vector<PhotonBeam> beams;
  for (uint32_t i = 0; i < 500; ++i) {
    const Vec3f from = point();
    const Vec3f to = i % 3 == 0 ? from + 0.1f * point() : point();
    // Some run along an axis.
    const Vec3f direction = i % 7 == 0 ? Vec3f(0, i % 2 == 0 ? 1.0f : -1.0f, 0) : glm::normalize(to - from);
    beams.push_back({from, direction, glm::length(to - from), Spectrum(1), 0, 0, i});
  }
  for (const float radius : {0.01f, 0.05f, 1.0f}) {
    PhotonBeamGrid grid(beams, radius);
    for (uint32_t part = grid.part_count(); part-- > 0;) grid.build_part(part);
    size_t found = 0;
    for (int i = 0; i < 300; ++i) {
      Ray ray{1.5f * point(), glm::normalize(point()), i % 2 == 0 ? infinity : 3 * random.next_float()};
      if (i % 5 == 0) ray.direction = Vec3f(0, 0, i % 2 == 0 ? 1.0f : -1.0f);
      std::multiset<uint32_t> seen;
      grid.find(ray, [&](const BeamCrossing& crossing) { seen.insert(crossing.beam); });
      for (uint32_t number = 0; number < beams.size(); ++number) {
        const PhotonBeam& beam = beams[number];
        const Vec3d n = glm::cross(Vec3d(ray.direction), Vec3d(beam.direction));
        const Vec3d w = Vec3d(ray.origin) - Vec3d(beam.origin);
        const double sine_squared = glm::dot(n, n);
        if (sine_squared < 1e-4) continue;  // where rounding decides
        const double gap = std::fabs(glm::dot(w, n)) / std::sqrt(sine_squared);
        const double cosine = glm::dot(Vec3d(ray.direction), Vec3d(beam.direction));
        const double along_d = glm::dot(w, Vec3d(ray.direction));
        const double along_q = glm::dot(w, Vec3d(beam.direction));
        const double t = (cosine * along_q - along_d) / sine_squared;
        const double s = (along_q - cosine * along_d) / sine_squared;
        const auto inside = [&](double slack) {
          return gap < static_cast<double>(radius) + slack && t >= -slack &&
                 t < static_cast<double>(ray.max_distance) + slack && s >= -slack &&
                 s < static_cast<double>(beam.length) + slack;
        };
        // Coordinates of 3 in floats over a sine of 0.01: 1e-4.
        constexpr double slack = 1e-4;
        EXPECT_LE(seen.count(number), inside(slack) ? 1u : 0u);
        if (inside(-slack)) {
          EXPECT_EQ(seen.count(number), 1u) << "ray " << i << " beam " << number;
        }
        found += seen.count(number);
      }
    }
    EXPECT_GT(found, 20u);
  }
}

TEST(PhotonBeams, SameBitsForAnyThreadsAndWhateverCameBefore) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + walls + area_light + diffuse_plate);
  const TestCamera camera(world->scene().sensor, 12, 8);
  std::optional<std::vector<uint32_t>> first;
  for (const int threads : {1, 2, 7}) {
    PhotonBeamsIntegrator integrator(world, {});
    // With one thread a pass in between, which must leave no trace.
    if (threads == 1) prepare_sample(integrator, camera, 5, 1);
    prepare_sample(integrator, camera, 2, threads);
    std::vector<uint32_t> bits;
    RayCounters counters;
    for (uint32_t pixel = 0; pixel < 96; ++pixel) {
      RandomStream random(1, pixel % 12, pixel / 12, 2);
      const Ray ray = camera.sample(pixel % 12, pixel / 12, random);
      const Spectrum radiance = integrator.sample(ray, random, counters).sampled;
      for (int channel = 0; channel < 3; ++channel)
        bits.push_back(std::bit_cast<uint32_t>(radiance[channel]));
    }
    if (!first) first = bits;
    EXPECT_EQ(bits, *first) << threads;
  }
}

TEST(PhotonBeams, WithoutLightThePictureIsBlack) {
  const auto world = transport::test::parse_world(fog("0.5", "0.8") + walls);
  const TestCamera camera(world->scene().sensor, 4, 4);
  PhotonBeamsIntegrator integrator(world, {});
  const Quarters found =
      take(integrator, camera, 0, 2, [&](uint32_t sample) { prepare_sample(integrator, camera, sample, 1); });
  for (const double mean : found.mean) EXPECT_EQ(mean, 0);
}

}  // namespace
}  // namespace fogbank::integrators
