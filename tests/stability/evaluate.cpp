// Evaluates the closed forms of server/derivatives in float and double for the cases that it reads, a JSON
// array, from standard input; answers with a JSON array on standard output. The driver is run.py, which knows
// the truth.
//
// Cases:   {"kind": "triangle", "point": [3], "vertices": [[3], [3], [3]]}
//          {"kind": "segment", "point": [2], "vertices": [[2], [2]]}
//          {"kind": "transmittance" | "integral", "sigma_t": s, "point": [3], "vertices": [[3]]}
//          {"kind": "batch", "directions": [[3], ...], "distances": [...], "triangles": [[3], ...],
//           "weights": [...], "sigma_t": s}
// Answers: {"float": field, "double": field}, field: {"value", "gradient": [...], "hessian": [...], "form"},
// where
//          form is "arctangent" or "edge" for triangles. Numbers that aren't finite come out as null.
#include <exception>
#include <iostream>
#include <nlohmann/json.hpp>

#include "derivatives/form_factor_batch.h"
#include "derivatives/segment_form_factor.h"
#include "derivatives/transmittance_jet.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

using nlohmann::json;

template <int Dim>
glm::vec<Dim, double> vector(const json& numbers) {
  glm::vec<Dim, double> result;
  for (int i = 0; i < Dim; ++i) result[i] = numbers.at(static_cast<size_t>(i)).get<double>();
  return result;
}

template <typename Real, int Dim>
json field(const Jet<Real, Dim>& jet) {
  json result{{"value", jet.value}, {"gradient", json::array()}, {"hessian", jet.hessian.entries}};
  for (int i = 0; i < Dim; ++i) result["gradient"].push_back(jet.gradient[i]);
  return result;
}

/// Differences are taken in double and rounded once, as everywhere in the engine that works in float.
template <typename Real>
json triangle(const json& entry) {
  using Vector = glm::vec<3, Real>;
  const json& vertices = entry.at("vertices");
  const auto exact =
      RelativeTriangle<double>::from_world(vector<3>(entry.at("point")), vector<3>(vertices.at(0)),
                                           vector<3>(vertices.at(1)), vector<3>(vertices.at(2)));
  RelativeTriangle<Real> rounded;
  for (size_t i = 0; i < 3; ++i) {
    rounded.vertices[i] = Vector(exact.vertices[i]);
    rounded.edges[i] = Vector(exact.edges[i]);
  }
  json result = field(triangle_form_factor_jet(rounded));
  const bool is_arctangent = select_triangle_form(scaled_vertices(rounded)) == TriangleForm::arctangent;
  result["form"] = is_arctangent ? "arctangent" : "edge";
  return result;
}

template <typename Real>
json segment(const json& entry) {
  using Vector = glm::vec<2, Real>;
  const Vec2d point = vector<2>(entry.at("point"));
  const Vec2d first = vector<2>(entry.at("vertices").at(0));
  const Vec2d second = vector<2>(entry.at("vertices").at(1));
  return field(
      segment_form_factor_jet(Vector(first - point), Vector(second - point), Vector(second - first)));
}

template <typename Real>
json transmittance(const json& entry) {
  const auto r = glm::vec<3, Real>(vector<3>(entry.at("vertices").at(0)) - vector<3>(entry.at("point")));
  const auto sigma_t = static_cast<Real>(entry.at("sigma_t").get<double>());
  const auto distance = distance_jet(r);
  return field(entry.at("kind") == "integral" ? transmittance_integral_jet(sigma_t, distance)
                                              : transmittance_jet(sigma_t, distance));
}

/// Weights are radiance times transmittance to the point.
template <typename Real>
json batch(const json& entry) {
  const Spectrum sigma_t(entry.at("sigma_t").get<float>());
  std::vector<BatchVertex<Real>> vertices;
  std::vector<BatchTriangle> triangles;
  std::vector<Spectrum> weights;
  for (size_t i = 0; i < entry.at("directions").size(); ++i) {
    const double distance = entry.at("distances").at(i);
    vertices.emplace_back(glm::vec<3, Real>(vector<3>(entry.at("directions").at(i))),
                          static_cast<Real>(1 / distance));
    weights.emplace_back(entry.at("weights").at(i).get<float>());
  }
  for (const json& corners : entry.at("triangles"))
    triangles.push_back({corners.get<std::array<uint32_t, 3>>(), BatchTriangle::all});
  const auto form_factors = gather_form_factors<Real>(vertices, triangles, DerivativeOrder::hessian);
  return field(
      gather_radiance<Real>(vertices, form_factors, weights, sigma_t, DerivativeOrder::hessian).channels[0]);
}

template <typename Real>
json evaluate(const json& entry) {
  const std::string kind = entry.at("kind");
  if (kind == "triangle") return triangle<Real>(entry);
  if (kind == "segment") return segment<Real>(entry);
  if (kind == "batch") return batch<Real>(entry);
  if (kind == "transmittance" || kind == "integral") return transmittance<Real>(entry);
  throw std::invalid_argument("unknown kind '" + kind + "'");
}

}  // namespace
}  // namespace fogbank::derivatives

int main() {
  using namespace fogbank::derivatives;
  try {
    json answers = json::array();
    for (const json& entry : json::parse(std::cin))
      answers.push_back({{"float", evaluate<float>(entry)}, {"double", evaluate<double>(entry)}});
    std::cout << answers << '\n';
    return 0;
  } catch (const std::exception& error) {
    std::cerr << "evaluate: error: " << error.what() << '\n';
    return 1;
  }
}
