// What the plan leaves out contributes nothing: forcing every term on changes no result beyond rounding.
#include <gtest/gtest.h>

#include "derivatives/estimator.h"
#include "derivatives/text_scene.h"

namespace fogbank::derivatives {
namespace {

struct Scene {
  const char* name;
  const char* sigma_t;
  const char* albedo;
  std::string body;
};

const std::vector<Scene>& scenes() {
  const std::string small_boundary =
      R"(<shape type="cube"><transform name="to_world"><scale value="5"/></transform>
      <bsdf type="null"/><ref name="interior" id="fog"/></shape>)";
  static const std::vector<Scene> all{
      {"a light in the open", "0.3", "0", test::ceiling_light},
      {"in a black room", "0.3", "0", test::ceiling_light + test::black_room},
      {"in a black room in a box of fog", "0.3", "0",
       test::ceiling_light + test::black_room + small_boundary},
      {"scattering", "0.3", "0.8", test::ceiling_light + test::black_room},
      {"without extinction", "0", "0", test::ceiling_light + test::black_room},
      {"a point light and a dark lamp", "0.2, 0.3, 0.4", "0",
       test::black_room +
           R"(<emitter type="point"/><shape type="sphere"><point name="center" x="1"/><float name="radius" value="0.1"/>
         <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
         <emitter type="area"><rgb name="radiance" value="0"/></emitter></shape>)"},
  };
  return all;
}

/// Largest difference of any number, relative to the largest of its kind.
double difference(const RadianceJet& a, const RadianceJet& b) {
  double value = 0;
  double gradient = 0;
  double hessian = 0;
  double value_size = 1e-30;
  double gradient_size = 1e-30;
  double hessian_size = 1e-30;
  for (size_t c = 0; c < 3; ++c) {
    value = std::max(value, std::fabs(a.channels[c].value - b.channels[c].value));
    gradient = std::max(gradient, glm::length(a.channels[c].gradient - b.channels[c].gradient));
    hessian = std::max(hessian, (a.channels[c].hessian - b.channels[c].hessian).norm());
    value_size = std::max(value_size, std::fabs(b.channels[c].value));
    gradient_size = std::max(gradient_size, glm::length(b.channels[c].gradient));
    hessian_size = std::max(hessian_size, b.channels[c].hessian.norm());
  }
  return std::max({value / value_size, gradient / gradient_size, hessian / hessian_size});
}

TEST(LeavingOut, ChangesNoResultBeyondRounding) {
  for (const char* method : {"aware", "unaware"}) {
    for (const Scene& scene : scenes()) {
      for (const Order order : {Order::single, Order::both}) {
        SCOPED_TRACE(std::string(method) + ", " + scene.name +
                     (order == Order::both ? ", both" : ", single"));
        const auto world = test::world_in_fog(scene.sigma_t, scene.albedo, scene.body);
        EstimatorSettings settings;
        settings.samples = 64;
        settings.order = order;
        settings.max_depth = 4;
        EstimatorSettings everything = settings;
        everything.leave_out = false;
        RayCounters planned_rays;
        RayCounters all_rays;
        const Vec3f x(0.3f, -0.2f, 0.1f);
        const RadianceJet planned = make_estimator(method, world, settings)->estimate(x, 0, planned_rays);
        const RadianceJet all = make_estimator(method, world, everything)->estimate(x, 0, all_rays);
        EXPECT_GT(planned.channels[0].value, 0);
        // Sums of some hundred terms, of single-precision factors where a medium is crossed.
        EXPECT_LT(difference(planned, all), 1e-6);
        EXPECT_LE(planned_rays.total(), all_rays.total());
      }
    }
  }
}

}  // namespace
}  // namespace fogbank::derivatives
