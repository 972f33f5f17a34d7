#include "derivatives/irradiance_gather.h"

#include <algorithm>
#include <cmath>

#include "derivatives/irradiance_edge.h"
#include "derivatives/irradiance_medium.h"
#include "derivatives/irradiance_noise.h"
#include "derivatives/sphere_mesh.h"
#include "derivatives/surface_radiance.h"

namespace fogbank::derivatives {

namespace {

/// Bisections of an outline (method.md section 17).
constexpr int32_t outline_steps = 4;
/// Ends nearer than this share of the scene's radius count as that near (method.md section 4.5).
constexpr float least_radii = 1e-4f;
/// Where infinity is, in radii of the scene (method.md section 7).
constexpr double far_radii = 1e4;
/// The triangulation is trusted as far as its own value is within this factor of the mean.
constexpr double most_ratio = 2;

/// The mesh around a point, split at outlines, and its cosine-weighted form factors.
struct HemisphereMesh {
  std::vector<Vec3d> vertices;  ///< relative to the point
  std::vector<uint32_t> rays;   ///< vertex of the grid that each belongs to
  VertexForms forms;
};

HemisphereMesh make_mesh(const HemisphereRays& rays, const Outlines& outlines, double radius,
                         const RayCounters& counters) {
  const HemisphereGrid& grid = rays.grid();
  const std::vector<uint8_t> all(grid.vertex_count(), 1);
  SphereMesh mesh =
      make_sphere_mesh({rays.directions(), rays.ends(), grid.triangles(), grid.triangle_edges()}, outlines,
                       all, least_radii * static_cast<float>(radius), counters);
  HemisphereMesh result{{}, std::move(mesh.rays), VertexForms(mesh.vertices.size())};
  for (const BatchVertex<float>& vertex : mesh.vertices) {
    const auto closeness = static_cast<double>(vertex.inverse_distance());
    result.vertices.push_back(Vec3d(vertex.direction()) * (closeness > 0
                                                               ? std::min(1 / closeness, far_radii * radius)
                                                               : far_radii * radius));
  }
  const Vec3d normal(rays.side().normal);
  for (size_t t = 0; t < mesh.triangles.size(); ++t) {
    counters.poll_at(t);
    const BatchTriangle& triangle = mesh.triangles[t];
    const auto& [a, b, c] = triangle.vertices;
    const Jet3d share =
        irradiance_form_factor(result.vertices[a], result.vertices[b], result.vertices[c], normal) *
        (1.0 / std::popcount(triangle.receivers));
    for (size_t i = 0; i < 3; ++i)
      if ((triangle.receivers >> i & 1u) != 0) result.forms[triangle.vertices[i]] += share;
  }
  return result;
}

Outlines outlines_of(const HemisphereRays& rays, std::span<const Spectrum> radiance, bool bisect,
                     RayCounters& counters) {
  const uint32_t cells = rays.grid().cell_count();
  std::vector<float> weights(cells);
  for (uint32_t i = 0; i < cells; ++i) weights[i] = luminance(rays.ends()[i].weight * radiance[i]);
  std::vector<HemisphereGrid::Edge> edges(rays.grid().inner_edges().begin(), rays.grid().inner_edges().end());
  // The surface's own horizon is no outline: it has no parallax.
  for (HemisphereGrid::Edge& edge : edges)
    if (!rays.leaves_outside(edge.a) || !rays.leaves_outside(edge.b)) edge.b = edge.a;
  Outlines outlines = find_outlines(rays.lines(), std::span(rays.ends()).first(cells), edges, weights,
                                    bisect ? outline_steps : 0, cells / outline_steps, counters);
  outlines.of_edge.resize(rays.grid().edges().size(), Outlines::none);
  return outlines;
}

/// Derivatives along the surface.
void project(Jet3d& jet, const Vec3d& normal) {
  jet.gradient -= normal * glm::dot(normal, jet.gradient);
  const Vec3d across = jet.hessian * normal;
  const double twice = glm::dot(normal, across);
  jet.hessian += Symmetric3d::outer(normal) * twice - Symmetric3d::outer_sum(normal, across);
}

void keep_finite(Jet3d& jet) {
  bool finite = std::isfinite(jet.value);
  for (int i = 0; i < 3; ++i) finite = finite && std::isfinite(jet.gradient[i]);
  for (const double entry : jet.hessian.entries) finite = finite && std::isfinite(entry);
  if (!finite) jet = Jet3d::constant(std::isfinite(jet.value) ? jet.value : 0);
}

/// Light from surfaces: `radiance` leaves the cells' ends towards the point.
void add_surfaces(const HemisphereRays& rays, const HemisphereMesh& mesh, std::span<const Spectrum> radiance,
                  IrradianceEstimate& estimate, const RayCounters& counters) {
  const uint32_t cells = rays.grid().cell_count();
  Vec3d mean(0);
  std::vector<uint32_t> surfaces(cells);
  for (uint32_t i = 0; i < cells; ++i) {
    mean += Vec3d(rays.ends()[i].weight * radiance[i]) / static_cast<double>(cells);
    surfaces[i] = rays.ends()[i].surface;
  }
  const std::vector<Spectrum> filtered = filter_over_neighbours(radiance, rays.grid().neighbours(), surfaces);
  RadianceJet sum;
  std::vector<Spectrum> gradients(cells, Spectrum(0));  // of what one unit of radiance adds
  for (size_t v = 0; v < mesh.forms.size(); ++v) {
    counters.poll_at(v);
    const uint32_t cell = rays.grid().parent(mesh.rays[v]);
    const Spectrum& light = filtered[cell];
    if (is_black(light)) continue;
    if (!rays.leaves_outside(cell) || !std::isfinite(rays.ends()[cell].distance)) {
      sum.add(mesh.forms[v], light * rays.ends()[cell].weight);
      continue;
    }
    const RadianceJet through = rays.lines().path(cell).towards(mesh.vertices[v]);
    for (size_t c = 0; c < 3; ++c)
      sum.channels[c] +=
          through.channels[c] * mesh.forms[v] * static_cast<double>(light[static_cast<int>(c)]);
    gradients[cell] += Spectrum((through.luminance() * mesh.forms[v]).gradient);
  }
  RadianceJet value;
  for (size_t c = 0; c < 3; ++c) value.channels[c].value = mean[static_cast<int>(c)];
  const double triangulated = sum.luminance().value;
  const double ratio =
      triangulated > 0 ? std::clamp(value.luminance().value / triangulated, 1 / most_ratio, most_ratio) : 1.0;
  sum *= ratio;
  for (size_t c = 0; c < 3; ++c) sum.channels[c].value = value.channels[c].value;
  estimate.mean += sum;
  // The filter is symmetric: noise enters through the filtered gradients.
  estimate.gradient_variance +=
      ratio * ratio *
      variance_of_sum(rays.grid(), surfaces, radiance,
                      filter_over_neighbours(gradients, rays.grid().neighbours(), surfaces));
}

}  // namespace

IrradianceEstimate gather_irradiance(const transport::World& world, const IrradianceSources& sources,
                                     const SurfaceSide& side, const IrradianceSettings& settings,
                                     RandomStream& random, RayCounters& counters) {
  const std::shared_ptr<const HemisphereGrid> grid =
      HemisphereGrid::of(HemisphereGrid::side_for(settings.samples));
  const HemisphereRays rays(world, *grid, side, random, counters);
  const uint32_t cells = grid->cell_count();
  std::vector<Spectrum> leaving(cells, Spectrum(0));
  const std::vector<Spectrum> sampled =
      surface_radiance(world, sources.surfaces, rays.hits(), static_cast<int32_t>(cells), random, counters);
  for (size_t i = 0; i < sampled.size(); ++i) leaving[rays.cells_of_hits()[i]] = sampled[i];
  const Outlines outlines = outlines_of(rays, leaving, settings.bisect, counters);
  const float radius = world.scene().bounds.radius;
  const HemisphereMesh mesh =
      make_mesh(rays, outlines, radius > 0 ? static_cast<double>(radius) : 1.0, counters);

  IrradianceEstimate estimate;
  add_surfaces(rays, mesh, leaving, estimate, counters);
  const MediumIrradiance medium = gather_medium_irradiance(world, sources.lines, rays, mesh.forms,
                                                           mesh.vertices, mesh.rays, random, counters);
  estimate.mean += medium.mean;
  estimate.gradient_variance += medium.gradient_variance;
  for (uint32_t i = 0; i < cells; ++i) leaving[i] = leaving[i] * rays.ends()[i].weight + medium.radiance[i];
  estimate.variance = variance_of_mean(leaving);
  for (Jet3d& channel : estimate.mean.channels) {
    project(channel, Vec3d(side.normal));
    keep_finite(channel);
  }
  if (!std::isfinite(estimate.variance)) estimate.variance = 0;
  if (!std::isfinite(estimate.gradient_variance)) estimate.gradient_variance = 0;
  return estimate;
}

}  // namespace fogbank::derivatives
