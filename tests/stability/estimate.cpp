// Mean radiance with derivatives in the scenes that it reads, a JSON array, from standard input; answers with
// a JSON array on standard output. The driver is run.py.
//
// Cases:   {"scene": XML between <scene> and </scene>, "points": [[3], ...], "order": "single" | "both",
//           "samples": n, "max_depth": n}
// Answers: [[{"value", "gradient": [3], "hessian": [6]} a channel] a point]. What isn't finite comes out as
// null.
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>

#include "derivatives/estimator.h"
#include "transport/world_builders.h"

namespace fogbank::derivatives {
namespace {

using nlohmann::json;

json estimate(const json& entry) {
  EstimatorSettings settings;
  settings.order = entry.at("order") == "both" ? Order::both : Order::single;
  settings.samples = entry.at("samples");
  settings.max_depth = entry.at("max_depth");
  // With all terms of the Hessian: what is left is rounding and the grid's resolution.
  settings.sliding = true;
  settings.corners = true;
  const auto estimator = make_estimator("aware", transport::test::parse_world(entry.at("scene")), settings);
  json answers = json::array();
  for (const json& point : entry.at("points")) {
    RayCounters counters;
    const Vec3f x(point.at(0).get<float>(), point.at(1).get<float>(), point.at(2).get<float>());
    const RadianceJet jet = estimator->estimate(x, 0, counters);
    json channels = json::array();
    for (const Jet3d& channel : jet.channels)
      channels.push_back({{"value", channel.value},
                          {"gradient", {channel.gradient.x, channel.gradient.y, channel.gradient.z}},
                          {"hessian", channel.hessian.entries}});
    answers.push_back(std::move(channels));
  }
  return answers;
}

}  // namespace
}  // namespace fogbank::derivatives

int main() {
  try {
    nlohmann::json answers = nlohmann::json::array();
    for (const nlohmann::json& entry : nlohmann::json::parse(std::cin))
      answers.push_back(fogbank::derivatives::estimate(entry));
    std::cout << answers << '\n';
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "estimate: error: " << error.what() << '\n';
    return 1;
  }
}
