#include "derivatives/irradiance_gather.h"

#include "core/frame.h"
#include "derivatives/irradiance_edge.h"

namespace fogbank::derivatives {

namespace {

/// What a ray found.
struct Vertex {
  Vec3d relative{0};  ///< to the surface seen
  float distance = infinity;
  uint32_t surface = 0;  ///< shape, or none seen
  Spectrum radiance{0};
};

constexpr uint32_t nothing = 0xFFFFFFFFu;

}  // namespace

IrradianceEstimate gather_irradiance(const transport::PathTracer& kernel, const HemisphereGrid& grid,
                                     const scene::SurfaceInteraction& surface, const Vec3f& normal,
                                     int32_t medium, int32_t depth, RandomStream& random,
                                     RayCounters& counters) {
  const scene::Scene& scene = kernel.world().scene();
  Frame frame = Frame::from_normal(normal);
  // A random turn: neighbouring records see different rays.
  const float turn = 2 * pi * random.next_float();
  const Vec3f tangent = frame.tangent * std::cos(turn) + frame.bitangent * std::sin(turn);
  frame = {tangent, glm::cross(normal, tangent), normal};

  const float far = scene.bounds.radius > 0 ? 2 * scene.bounds.radius : 1.0f;
  std::vector<Vertex> vertices(grid.vertex_count());
  IrradianceEstimate estimate;
  double inverse_sum = 0;
  for (uint32_t i = 0; i < vertices.size(); ++i) {
    const Vec3f direction = frame.to_world(grid.direction(i, random.next_vec2() * 2.0f - 1.0f));
    Vertex& vertex = vertices[i];
    scene::Hit hit;
    vertex.radiance = kernel.arriving_radiance({surface.spawn_origin(direction), direction, infinity}, medium,
                                               depth, random, counters, &hit);
    const bool seen = std::isfinite(hit.distance);
    vertex.distance = seen ? hit.distance : far;
    vertex.surface = seen ? hit.shape : nothing;
    vertex.relative = Vec3d(direction) * static_cast<double>(vertex.distance);
    estimate.nearest = std::fmin(estimate.nearest, vertex.distance);
    inverse_sum += 1.0 / static_cast<double>(vertex.distance);
  }
  estimate.harmonic_distance = static_cast<float>(static_cast<double>(vertices.size()) / inverse_sum);

  // Radiance of a triangle: the farthest vertex's where it joins two surfaces, the mean elsewhere (method.md
  // section 5, mixing rule); the value takes the mean everywhere, as the farthest rule is biased (6.1).
  const auto& triangles = grid.triangles();
  std::vector<Spectrum> weights(triangles.size());
  std::vector<Spectrum> means(triangles.size());
  for (size_t t = 0; t < triangles.size(); ++t) {
    const Vertex& a = vertices[triangles[t][0]];
    const Vertex& b = vertices[triangles[t][1]];
    const Vertex& c = vertices[triangles[t][2]];
    means[t] = (a.radiance + b.radiance + c.radiance) * (1.0f / 3);
    const Vertex* farthest = a.distance > b.distance ? &a : &b;
    if (c.distance > farthest->distance) farthest = &c;
    weights[t] = a.surface == b.surface && b.surface == c.surface ? means[t] : farthest->radiance;
    const float factor = 1.0f / (static_cast<float>(triangles.size()));
    // Spread within a triangle, as if its three samples were the stratum's.
    float spread = 0;
    for (const Vertex* vertex : {&a, &b, &c}) spread += sqr(luminance(vertex->radiance - means[t]));
    estimate.variance += static_cast<double>(spread * sqr(factor));
  }
  const Vec3d n(normal);
  for (const HemisphereGrid::Edge& edge : grid.edges()) {
    Spectrum jump = weights[edge.left];
    Spectrum mean_jump = means[edge.left];
    if (edge.right != HemisphereGrid::no_triangle) {
      jump -= weights[edge.right];
      mean_jump -= means[edge.right];
    }
    if (is_black(jump) && is_black(mean_jump)) continue;
    Jet3d term = irradiance_edge_term<double>(vertices[edge.from].relative, vertices[edge.to].relative, n);
    const double value = term.value;
    term.value = 0;
    estimate.mean.add(term, jump);
    for (int c = 0; c < 3; ++c)
      estimate.mean.channels[static_cast<size_t>(c)].value += value * static_cast<double>(mean_jump[c]);
  }
  return estimate;
}

}  // namespace fogbank::derivatives
