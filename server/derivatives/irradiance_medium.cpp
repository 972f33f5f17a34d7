#include "derivatives/irradiance_medium.h"

#include <algorithm>
#include <cmath>

#include "derivatives/irradiance_edge.h"
#include "derivatives/irradiance_noise.h"
#include "derivatives/medium_rays.h"
#include "derivatives/medium_shells.h"
#include "derivatives/surface_radiance.h"

namespace fogbank::derivatives {

namespace {

/// What ends nowhere counts as ending this many scene radii away (method.md section 7, "Misses").
constexpr double far_radii = 1e4;

/// The medium along a ray, as far as its source is left aside.
struct Line {
  Vec3d scattering{0};  ///< integral of sigma_s T
  double distance = 0;  ///< mean of the distance, weighted by that; 0 where nothing scatters
  bool is_uniform = true;
};

/// Integrates along a ray and samples its light.
Line look_along(const transport::World& world, const LineSource& source, const Vec3f& origin,
                const MediumRay& ray, double far, Spectrum& radiance, RandomStream& random,
                RayCounters& counters) {
  Line line;
  line.is_uniform = ray.stretches.size() == 1;
  Vec3d before(1);
  double weighted = 0;
  for (const MediumStretch& stretch : ray.stretches) {
    const Vec3d through = before * Vec3d(stretch.through);
    if (stretch.medium == scene::none) continue;
    const transport::MediumInfo& medium = world.medium(stretch.medium);
    const double length = std::max(std::min(stretch.end, far) - stretch.begin, 0.0);
    for (int c = 0; c < 3; ++c) {
      const auto sigma_t = static_cast<double>(medium.sigma_t[c]);
      const double scattered = through[c] * static_cast<double>(medium.sigma_s[c]);
      const double integral = transmittance_integral(sigma_t, length);
      line.scattering[c] += scattered * integral;
      weighted +=
          scattered * (stretch.begin * integral + length * mean_transmitted_distance(sigma_t, length));
      before[c] *= transmittance(sigma_t, length);
    }
    const Spectrum share(through);
    if (is_black(medium.sigma_s) || is_black(share) || !(length > 0)) continue;
    const Vec3f begin = origin + Vec3f(ray.direction * stretch.begin);
    radiance += share * source.in_scattered({begin, Vec3f(ray.direction), infinity},
                                            static_cast<float>(stretch.end - stretch.begin), stretch.medium,
                                            random, counters);
  }
  const double total = line.scattering.x + line.scattering.y + line.scattering.z;
  line.distance = total > 0 ? weighted / total : 0;
  return line;
}

/// Form factors by cell of the grid's own triangles, its vertices at the lines' distances.
VertexForms forms_at(const HemisphereRays& rays, std::span<const Line> lines, const RayCounters& counters) {
  const HemisphereGrid& grid = rays.grid();
  VertexForms forms(grid.cell_count());
  const Vec3d normal(rays.side().normal);
  for (size_t t = 0; t < grid.triangles().size(); ++t) {
    counters.poll_at(t);
    const HemisphereGrid::Triangle& corners = grid.triangles()[t];
    const auto vertex = [&](size_t i) {
      return Vec3d(rays.directions()[corners[i]]) * lines[grid.parent(corners[i])].distance;
    };
    const Jet3d third = irradiance_form_factor(vertex(0), vertex(1), vertex(2), normal) * (1.0 / 3);
    for (const uint32_t corner : corners) forms[grid.parent(corner)] += third;
  }
  return forms;
}

}  // namespace

MediumIrradiance gather_medium_irradiance(const transport::World& world, const LineSource& source,
                                          const HemisphereRays& rays, const VertexForms& forms,
                                          std::span<const Vec3d> vertices, std::span<const uint32_t> rays_of,
                                          RandomStream& random, RayCounters& counters) {
  const HemisphereGrid& grid = rays.grid();
  const uint32_t cells = grid.cell_count();
  MediumIrradiance result;
  result.radiance.assign(cells, Spectrum(0));
  const auto radius = static_cast<double>(world.scene().bounds.radius);
  const double far = far_radii * (radius > 0 ? radius : 1);
  const std::vector<MediumRay> media = medium_rays(rays.lines(), counters);
  std::vector<Line> lines(cells);
  Vec3d light(0);
  Vec3d scattering(0);
  double distance = 0;
  double scattering_cells = 0;
  for (uint32_t cell = 0; cell < cells; ++cell) {
    if (!rays.leaves_outside(cell)) continue;
    lines[cell] = look_along(world, source, rays.lines().origin(), media[cell], far, result.radiance[cell],
                             random, counters);
    light += Vec3d(result.radiance[cell]);
    scattering += lines[cell].scattering;
    distance += lines[cell].distance;
    scattering_cells += lines[cell].distance > 0 ? 1 : 0;
  }
  for (int c = 0; c < 3; ++c)
    result.mean.channels[static_cast<size_t>(c)].value = light[c] / static_cast<double>(cells);
  if (light == Vec3d(0) || !(scattering_cells > 0)) return result;
  // Where no medium is, any distance will do.
  for (Line& line : lines)
    if (!(line.distance > 0)) line.distance = distance / scattering_cells;

  Vec3d constant(0);
  for (int c = 0; c < 3; ++c) constant[c] = scattering[c] > 0 ? light[c] / scattering[c] : 0;
  const int32_t around = rays.lines().medium();
  RadianceJet derivatives;
  for (size_t v = 0; v < forms.size(); ++v) {
    counters.poll_at(v);
    const uint32_t cell = grid.parent(rays_of[v]);
    if (!rays.leaves_outside(cell)) continue;
    const Line& line = lines[cell];
    for (int c = 0; c < 3; ++c) {
      Jet3d integral = Jet3d::constant(line.scattering[c]);
      if (line.is_uniform && around != scene::none) {
        const transport::MediumInfo& medium = world.medium(around);
        integral =
            transmittance_integral_jet(static_cast<double>(medium.sigma_t[c]), distance_jet(vertices[v])) *
            static_cast<double>(medium.sigma_s[c]);
      }
      derivatives.channels[static_cast<size_t>(c)] += integral * forms[v] * constant[c];
    }
  }
  std::vector<Spectrum> beyond(cells);
  for (uint32_t cell = 0; cell < cells; ++cell)
    beyond[cell] = result.radiance[cell] - Spectrum(constant * lines[cell].scattering);
  const std::vector<uint32_t> everywhere(cells, 0);
  const std::vector<Spectrum> filtered = filter_over_neighbours(beyond, grid.neighbours(), everywhere);
  const VertexForms at_distance = forms_at(rays, lines, counters);
  std::vector<Spectrum> gradients;
  for (uint32_t cell = 0; cell < cells; ++cell) {
    const Jet3d& form = at_distance[cell];
    const Vec3d direction(rays.directions()[cell]);
    const Jet3d length = distance_jet(direction * lines[cell].distance);
    // Shells are crossed at an angle once the point has moved (method.md section 8.3).
    const Jet3d oblique{0, Vec3d(0),
                        (Symmetric3d::identity() - Symmetric3d::outer(direction)) *
                            (form.value / (lines[cell].distance * lines[cell].distance))};
    Vec3d gradient(0);
    for (int c = 0; c < 3; ++c) {
      const double sigma_t = around == scene::none ? 0 : static_cast<double>(world.medium(around).sigma_t[c]);
      const Jet3d seen = chain(length, 1.0, -sigma_t, sigma_t * sigma_t) * form + oblique;
      derivatives.channels[static_cast<size_t>(c)] += seen * static_cast<double>(filtered[cell][c]);
      gradient += luminance_weights[static_cast<size_t>(c)] * seen.gradient;
    }
    gradients.emplace_back(gradient);
  }
  // The filter is symmetric: noise enters through the filtered gradients.
  result.gradient_variance = variance_of_sum(
      grid, everywhere, beyond, filter_over_neighbours(gradients, grid.neighbours(), everywhere));
  for (size_t c = 0; c < 3; ++c) {
    derivatives.channels[c].value = result.mean.channels[c].value;
    result.mean.channels[c] = derivatives.channels[c];
  }
  return result;
}

}  // namespace fogbank::derivatives
