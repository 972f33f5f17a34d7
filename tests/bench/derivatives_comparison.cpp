// Derivatives of every method against finite differences in real scenes, as a table: `make bench`, part
// derivatives.
//
//     derivatives_comparison [POINTS [SAMPLES [direct|surfaces|medium [each]]]]
//
// `each` prints every point.
#include <algorithm>
#include <charconv>
#include <cstdio>
#include <iterator>
#include <string>
#include <string_view>

#include "derivatives/scene_comparison.h"

namespace {

using namespace fogbank;
using namespace fogbank::derivatives;

struct Part {
  const char* name;
  Order order;
  int32_t max_depth;
  bool with_sky;
};

/// The direct light of sun and lamp has a reference without noise; the others' is path traced.
constexpr Part parts[] = {{"direct", Order::single, 2, false},
                          {"surfaces", Order::single, -1, true},
                          {"medium", Order::multiple, -1, true}};

struct Variant {
  const char* name;
  const char* method;
  bool corners;  ///< the term where a blocker's outline crosses the light's: the Hessian of round suns
};
constexpr Variant variants[] = {
    {"aware", "aware", true}, {"aware, no corners", "aware", false}, {"unaware", "unaware", false}};

void compare(const derivatives::test::ComparedScene& scene, const Part& part, int count, int32_t samples,
             bool each_point) {
  const auto world = derivatives::test::load_with_finite_sun(scene, part.with_sky);
  if (world == nullptr) {
    std::printf("%-10s skipped: the shared data is absent\n", scene.name);
    return;
  }
  EstimatorSettings settings;
  settings.order = part.order;
  settings.max_depth = part.max_depth;
  settings.samples = samples;
  const std::vector<Vec3f> points = derivatives::test::points_before_the_camera(*world, count, 1);
  const auto run = [&](const std::string& method, int32_t repeats, double& seconds, double& rays) {
    settings.repeats = repeats;
    const auto estimator = make_estimator(method, world, settings);
    std::vector<PointEstimate> estimates;
    for (const Vec3f& x : points) {
      estimates.push_back(average(*estimator, settings, x));
      seconds += estimates.back().seconds / (repeats * static_cast<double>(points.size()));
      rays += static_cast<double>(estimates.back().samples) / (repeats * static_cast<double>(points.size()));
    }
    return estimates;
  };

  double seconds = 0;
  double rays = 0;
  const std::vector<PointEstimate> references = run("finite-difference", 2, seconds, rays);
  const derivatives::test::ReferenceFloor floor = derivatives::test::reference_floor(references);
  std::vector<double> noise;
  for (const PointEstimate& reference : references) {
    const double length = glm::length(reference.mean.luminance().gradient);
    if (length > floor.gradient)
      noise.push_back(glm::length(reference.luminance_standard_error.gradient) / length);
  }
  std::printf(
      "%-10s %-9s %-18s %6.0f ms %8.0f rays  its own noise in the gradient: median %.2g %%, 90 %% %.2g %%\n",
      scene.name, part.name, "finite-difference", 1e3 * seconds, rays,
      100 * derivatives::test::quantile(noise, 0.5), 100 * derivatives::test::quantile(noise, 0.9));
  for (const Variant& variant : variants) {
    seconds = rays = 0;
    settings.corners = variant.corners;
    const std::vector<PointEstimate> estimates = run(variant.method, 1, seconds, rays);
    std::vector<double> gradient;
    std::vector<double> hessian;
    std::vector<double> angle;
    int false_gradients = 0;
    for (size_t i = 0; i < points.size(); ++i) {
      const Jet3d reference = references[i].mean.luminance();
      const derivatives::test::DerivativeErrors errors =
          errors_of(estimates[i].mean.luminance(), reference, floor);
      if (glm::length(reference.gradient) > floor.gradient) {
        gradient.push_back(errors.gradient);
        hessian.push_back(errors.hessian);
        angle.push_back(errors.angle);
      } else if (errors.gradient > 1) {
        ++false_gradients;
      }
      if (each_point)
        std::printf("  %g %g %g: %.3g (%.3g) gradient %.3g (%.3g %.3g %.3g) hessian %.3g of %.3g\n",
                    static_cast<double>(points[i].x), static_cast<double>(points[i].y),
                    static_cast<double>(points[i].z), estimates[i].mean.luminance().value, reference.value,
                    errors.gradient, reference.gradient.x, reference.gradient.y, reference.gradient.z,
                    errors.hessian, reference.hessian.norm());
    }
    std::printf(
        "%-10s %-9s %-18s %6.1f ms %8.0f rays  %3zu points: gradient %6.2f %% %6.1f %%  angle %6.2f %6.1f "
        "deg  "
        "Hessian %6.1f %% %6.1f %%; %d of the other %zu wrong\n",
        scene.name, part.name, variant.name, 1e3 * seconds, rays, gradient.size(),
        100 * derivatives::test::quantile(gradient, 0.5), 100 * derivatives::test::quantile(gradient, 0.9),
        derivatives::test::quantile(angle, 0.5), derivatives::test::quantile(angle, 0.9),
        100 * derivatives::test::quantile(hessian, 0.5), 100 * derivatives::test::quantile(hessian, 0.9),
        false_gradients, points.size() - gradient.size());
  }
  std::fflush(stdout);
}

/// 0 for what is no whole number.
int whole_number(std::string_view text) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() ? value : 0;
}

}  // namespace

int main(int argc, char** argv) {
  const int points = argc > 1 ? whole_number(argv[1]) : 100;
  const int samples = argc > 2 ? whole_number(argv[2]) : 1024;
  const std::string wanted = argc > 3 ? argv[3] : "";
  const bool each_point = argc > 4 && std::string(argv[4]) == "each";
  const bool known = wanted.empty() || std::any_of(std::begin(parts), std::end(parts),
                                                   [&](const Part& part) { return wanted == part.name; });
  if (points < 1 || samples < EstimatorLimits::fewest_samples || !known) {
    std::fprintf(stderr,
                 "usage: derivatives_comparison [POINTS [SAMPLES [direct|surfaces|medium [each]]]]\n");
    return 2;
  }
  std::printf(
      "relative errors of luminance against finite differences: median, 90 %%, over the points whose "
      "gradient\n"
      "is more than 5 %% of the median one; of the others those with a false gradient above that\n");
  for (const derivatives::test::ComparedScene& scene : derivatives::test::compared_scenes())
    for (const Part& part : parts)
      if (wanted.empty() || wanted == part.name) compare(scene, part, points, samples, each_point);
}
