#include "derivatives/irradiance_medium.h"

#include <algorithm>
#include <cmath>

#include "derivatives/irradiance_edge.h"
#include "derivatives/medium_march.h"
#include "derivatives/medium_rays.h"
#include "derivatives/medium_record.h"

namespace fogbank::derivatives {

namespace {

/// Mean of the source in the first stratum around the point: any constant near the source's value there does.
Vec3d nearby_mean(const MediumRecord& record) {
  Vec3d sum(0);
  double count = 0;
  for (const MediumSample& sample : record.samples) {
    if (!sample.near) continue;
    sum += sample.source;
    ++count;
  }
  return count > 0 ? sum / count : Vec3d(0);
}

/// What a ray's samples differ from the constant source by. The first stratum is seen through its outermost
/// sample, as MediumRecord does: linear for the gradient, quadratic for the Hessian.
ShellMoments<double> moments_of(const MediumRecord& record, size_t ray, int channel) {
  ShellMoments<double> moments;
  const double sigma_t = record.sigma_t[channel];
  double gradient_0 = 0;
  double gradient_1 = 0;
  double hessian_2 = 0;
  for (const MediumSample& sample : record.samples_of(ray)) {
    if (sample.near) continue;
    const double constant = sample.stretch == 0 ? record.constant[channel] : 0;
    const double weight = sample.weight[channel] * (sample.source[channel] - constant);
    gradient_0 += weight;
    gradient_1 += weight / sample.distance;
    hessian_2 += weight / sample.distance / sample.distance;
  }
  double hessian_0 = gradient_0;
  double hessian_1 = gradient_1;
  if (!record.nearby.empty() && record.nearby[ray].distance > 0) {
    const NearbySample& look = record.nearby[ray];
    const double linear =
        record.sigma_s[channel] * (look.source[channel] - record.constant[channel]) / look.distance;
    const double quadratic = linear / look.distance;
    const NearIntegrals integrals = near_integrals(sigma_t, look.length);
    gradient_0 += linear * integrals.order1;
    gradient_1 += linear * integrals.order0;
    hessian_0 += quadratic * integrals.order2;
    hessian_1 += quadratic * integrals.order1;
    hessian_2 += quadratic * integrals.order0;
  }
  moments.add_homogeneous(record.rays[ray].direction, sigma_t, gradient_0, gradient_1, hessian_0, hessian_1,
                          hessian_2);
  return moments;
}

/// Form factors of the unit hemisphere, by cell.
VertexForms unit_forms(const HemisphereRays& rays, const RayCounters& counters) {
  VertexForms forms(rays.grid().cell_count());
  const Vec3d normal(rays.side().normal);
  for (size_t t = 0; t < rays.grid().triangles().size(); ++t) {
    counters.poll_at(t);
    const HemisphereGrid::Triangle& corners = rays.grid().triangles()[t];
    const auto direction = [&](size_t i) { return Vec3d(rays.directions()[corners[i]]); };
    const Jet3d third = irradiance_form_factor(direction(0), direction(1), direction(2), normal) * (1.0 / 3);
    for (const uint32_t vertex : corners) forms[rays.grid().parent(vertex)] += third;
  }
  return forms;
}

}  // namespace

MediumIrradiance gather_medium_irradiance(const transport::World& world, const MediumSource& source,
                                          const HemisphereRays& rays, const VertexForms& forms,
                                          std::span<const Vec3d> vertices, std::span<const uint32_t> rays_of,
                                          RandomStream& random, RayCounters& counters) {
  const uint32_t cells = rays.grid().cell_count();
  MediumIrradiance result;
  result.radiance.assign(cells, Spectrum(0));
  std::vector<MediumRay> marched;
  std::vector<uint32_t> cell_of;
  std::vector<MediumRay> all = medium_rays(rays.lines(), counters);
  for (uint32_t cell = 0; cell < cells; ++cell) {
    if (!rays.leaves_outside(cell)) continue;
    marched.push_back(std::move(all[cell]));
    cell_of.push_back(cell);
  }
  if (marched.empty()) return result;
  MediumRecord record(world, rays.lines().origin(), marched, {}, {});
  MediumGather(world, source).march(record, random, counters);
  if (record.samples.empty()) return result;
  Vec3d mean(0);
  for (size_t i = 0; i < marched.size(); ++i) {
    Vec3d sum(0);
    for (const MediumSample& sample : record.samples_of(i)) sum += sample.weight * sample.source;
    result.radiance[cell_of[i]] = Spectrum(sum);
    mean += sum / static_cast<double>(cells);
  }

  // The constant part, up to the end of the medium around the point.
  record.constant = nearby_mean(record);
  std::vector<size_t> ray_of(cells, marched.size());
  for (size_t i = 0; i < cell_of.size(); ++i) ray_of[cell_of[i]] = i;
  for (size_t v = 0; v < forms.size(); ++v) {
    counters.poll_at(v);
    const uint32_t cell = rays.grid().parent(rays_of[v]);
    if (ray_of[cell] == marched.size()) continue;
    const bool ends_here = marched[ray_of[cell]].stretches.size() == 1;
    const Jet3d distance =
        ends_here ? distance_jet(vertices[v]) : Jet3d::constant(record.first_end(ray_of[cell]));
    for (int c = 0; c < 3; ++c)
      if (record.sigma_s[c] > 0)
        result.mean.channels[static_cast<size_t>(c)] +=
            transmittance_integral_jet(record.sigma_t[c], distance) * forms[v] *
            (record.sigma_s[c] * record.constant[c]);
  }
  const VertexForms unit = unit_forms(rays, counters);
  std::vector<Vec3d> shares(cells, Vec3d(0));  // of the gradient of the luminance
  for (size_t i = 0; i < marched.size(); ++i) {
    counters.poll_at(i);
    for (int c = 0; c < 3; ++c) {
      const Jet3d jet = shell_jet(unit[cell_of[i]], marched[i].direction, moments_of(record, i, c));
      result.mean.channels[static_cast<size_t>(c)] += jet;
      shares[cell_of[i]] += luminance_weights[static_cast<size_t>(c)] * jet.gradient;
    }
  }
  for (uint32_t cell = 0; cell < cells; ++cell)
    for (const uint32_t other : rays.grid().neighbours()[cell]) {
      const Vec3d difference = shares[cell] - shares[other];
      result.gradient_variance += glm::dot(difference, difference) / 16;
    }
  for (size_t c = 0; c < 3; ++c) result.mean.channels[c].value = mean[static_cast<int>(c)];
  return result;
}

}  // namespace fogbank::derivatives
