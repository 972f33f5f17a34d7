#include "derivatives/light_triangles.h"

#include <algorithm>
#include <cmath>

#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

namespace {

constexpr double widest_cell = 0.2;  ///< rad
/// Halvings one within the other: a cell seen under half the sphere takes 10.
constexpr int most_splits = 16;

RadianceJet mean_of(const RadianceJet& a, const RadianceJet& b, const RadianceJet& c) {
  RadianceJet sum = a;
  sum += b;
  sum += c;
  sum *= 1.0 / 3;
  return sum;
}

double cosine(const LightVertex& a, const LightVertex& b) {
  const double lengths = glm::length(a.position) * glm::length(b.position);
  return lengths > 0 ? glm::dot(a.position, b.position) / lengths : 1;
}

}  // namespace

RadianceJet mean_of(const RadianceJet& a, const RadianceJet& b) {
  RadianceJet sum = a;
  sum += b;
  sum *= 0.5;
  return sum;
}

Jet3d LightTriangles::form_factor(const Vec3d& a, const Vec3d& b, const Vec3d& c) const {
  const auto triangle = RelativeTriangle<double>::from_relative(a, b, c);
  if (grid_.at_infinity || order_ == DerivativeOrder::value)
    return Jet3d::constant(triangle_form_factor(triangle));
  return triangle_form_factor_jet(triangle);
}

void LightTriangles::add(const Jet3d& field, const RadianceJet& transmittance, const Spectrum& radiance,
                         RadianceJet& sum) {
  for (size_t c = 0; c < 3; ++c) {
    const double weight = radiance[static_cast<int>(c)];
    if (weight != 0) sum.channels[c] += (field * transmittance.channels[c]) * weight;
  }
}

void LightTriangles::add_triangle(const LightVertex& a, const LightVertex& b, const LightVertex& c,
                                  bool in_one_medium, const Spectrum& radiance, RadianceJet& sum) const {
  if (in_one_medium && !grid_.at_infinity) {
    add_in_medium(a, b, c, radiance, 0, sum);
  } else {
    add(form_factor(a.position, b.position, c.position),
        mean_of(a.transmittance, b.transmittance, c.transmittance), radiance, sum);
  }
}

void LightTriangles::split(const LightVertex& from, const LightVertex& to, const LightVertex& opposite,
                           const Spectrum& radiance, int splits, RadianceJet& sum) const {
  LightVertex middle;
  middle.position = grid_.between(from.position, to.position, 0.5);
  middle.transmittance = medium_.towards(middle.position);
  add_in_medium(from, middle, opposite, radiance, splits + 1, sum);
  add_in_medium(middle, to, opposite, radiance, splits + 1, sum);
}

void LightTriangles::add_in_medium(const LightVertex& a, const LightVertex& b, const LightVertex& c,
                                   const Spectrum& radiance, int splits, RadianceJet& sum) const {
  const double ab = cosine(a, b);
  const double bc = cosine(b, c);
  const double ca = cosine(c, a);
  const double least = std::min({ab, bc, ca});
  if (splits < most_splits && least < std::cos(widest_cell)) {
    if (least == ab) return split(a, b, c, radiance, splits, sum);
    if (least == bc) return split(b, c, a, radiance, splits, sum);
    return split(c, a, b, radiance, splits, sum);
  }
  RadianceJet transmittance = mean_of(a.transmittance, b.transmittance, c.transmittance);
  transmittance *= 0.25;
  RadianceJet middle = medium_.towards(grid_.middle(a.position, b.position, c.position));
  middle *= 0.75;
  transmittance += middle;
  add(form_factor(a.position, b.position, c.position), transmittance, radiance, sum);
}

void add_unoccluded(const LightGrid& grid, const Spectrum& sigma_t, DerivativeOrder order,
                    const RayCounters& counters, RadianceJet& sum) {
  const LightTriangles triangles(grid, sigma_t, order);
  MediaPath medium;
  medium.sigma_t = sigma_t;
  const auto vertex = [&](const Vec3d& position) { return LightVertex{position, medium.towards(position)}; };
  for (size_t t = 0; t < grid.unoccluded.size(); ++t) {
    counters.poll_at(t);
    const LightGrid::Unoccluded& triangle = grid.unoccluded[t];
    const auto& [a, b, c] = triangle.vertices;
    triangles.add_triangle(vertex(a), vertex(b), vertex(c), !is_black(sigma_t), triangle.radiance, sum);
  }
}

}  // namespace fogbank::derivatives
