#include "derivatives/medium_gather.h"

#include <algorithm>
#include <cmath>

#include "derivatives/medium_march.h"
#include "derivatives/medium_record.h"

namespace fogbank::derivatives {

namespace {

/// Steps of phases that fill [0, 1) evenly: from stratum to stratum and from ray to ray (inverses of the
/// golden ratio and of the plastic number).
constexpr double stratum_turn = 0.6180339887498949;
constexpr double ray_turn = 0.7548776662466927;
/// The medium close to the point is looked at no farther out than this share of the way to a surface.
constexpr double near_share = 0.75;
/// Samples stop short of the surfaces and boundaries that end a stretch by this share of the way, or rounding
/// would put some of them behind.
constexpr double inside_share = 1 - 1e-4;
/// The constant that is subtracted is measured with one sample for every four rays: its noise is then two
/// thirds of what the samples closest to the point bring into the Hessian.
constexpr size_t rays_per_constant_sample = 4;
constexpr size_t least_constant_samples = 16;

Vec3d transmittances(const Vec3d& sigma_t, double distance) {
  return {transmittance(sigma_t.x, distance), transmittance(sigma_t.y, distance),
          transmittance(sigma_t.z, distance)};
}

void keep_finite(Jet3d& jet) {
  const auto keep = [](double& number) {
    if (!std::isfinite(number)) number = 0;
  };
  keep(jet.value);
  for (int i = 0; i < 3; ++i) keep(jet.gradient[i]);
  for (double& entry : jet.hessian.entries) keep(entry);
}

}  // namespace

Spectrum MediumGather::source_at(const MediumRecord& record, size_t ray, double distance, int32_t medium,
                                 RandomStream& random, RayCounters& counters) const {
  const Vec3f y = record.x + Vec3f(record.rays[ray].direction * distance);
  return source_.mean_radiance(y, medium, random, counters);
}

void MediumGather::march_stretch(MediumRecord& record, size_t ray, size_t index, std::span<const double> ends,
                                 double phase, RandomStream& random, RayCounters& counters) const {
  const MediumStretch& stretch = record.rays[ray].stretches[index];
  const transport::MediumInfo& medium = world_.medium(stretch.medium);
  const Vec3d sigma_t(medium.sigma_t);
  Vec3d before(stretch.through);
  for (size_t i = 0; i < index; ++i) {
    const MediumStretch& passed = record.rays[ray].stretches[i];
    if (passed.medium != scene::none)
      before *= transmittances(Vec3d(world_.medium(passed.medium).sigma_t), passed.end - passed.begin);
  }
  const double length = record.end(stretch.end) - stretch.begin;
  double begin = 0;
  for (size_t k = 0; k < ends.size() && begin < length; ++k) {
    const double end = std::min(ends[k], length);
    // Rays out of step: what a march with coarse strata misses then differs from ray to ray and cancels,
    // instead of being an error common to them all.
    const double turned = phase + static_cast<double>(k) * stratum_turn + static_cast<double>(ray) * ray_turn;
    const DistanceSample drawn = sample_stratum(sigma_t, begin, end, turned - std::floor(turned));
    const double within = std::min(drawn.distance, length * inside_share);
    MediumSample sample{stretch.begin + within, static_cast<uint32_t>(index), index == 0 && k == 0,
                        before * Vec3d(medium.sigma_s) * transmittances(sigma_t, within) * drawn.inverse_pdf,
                        Vec3d(0)};
    begin = end;
    if (sample.weight == Vec3d(0)) continue;
    sample.source = Vec3d(source_at(record, ray, sample.distance, stretch.medium, random, counters));
    record.samples.push_back(sample);
  }
}

double MediumGather::march(MediumRecord& record, RandomStream& random, RayCounters& counters) const {
  const auto phase = static_cast<double>(random.next_float());
  double extent = 0;
  for (size_t i = 0; i < record.rays.size(); ++i) extent = std::max(extent, record.first_end(i));
  std::vector<double> around;
  if (record.sigma_s != Vec3d(0)) {
    around = source_.exact()
                 ? marching_strata(record.sigma_t, extent, settings_.optical_step, settings_.steps)
                 : importance_strata(record.sigma_t, extent, settings_.noisy_strata);
  }
  for (size_t i = 0; i < record.rays.size(); ++i) {
    record.first.push_back(record.samples.size());
    const std::vector<MediumStretch>& stretches = record.rays[i].stretches;
    if (!around.empty()) march_stretch(record, i, 0, around, phase, random, counters);
    Vec3d before = transmittances(record.sigma_t, record.first_end(i));
    for (size_t j = 1; j < stretches.size(); ++j) {
      const int32_t medium = stretches[j].medium;
      const double length = record.end(stretches[j].end) - stretches[j].begin;
      if (medium == scene::none || !(length > 0)) continue;
      const Vec3d sigma_t(world_.medium(medium).sigma_t);
      const Vec3d behind = before * transmittances(sigma_t, length);
      const double share = glm::dot(before - behind, Vec3d(1.0 / 3));
      before = behind;
      if (is_black(world_.medium(medium).sigma_s)) continue;
      // Far media that little light leaves get fewer of the dear samples.
      march_stretch(record, i, j,
                    source_.exact()
                        ? marching_strata(sigma_t, length, settings_.optical_step, settings_.steps)
                        : importance_strata(sigma_t, length,
                                            1 + static_cast<int>(share * (settings_.noisy_strata - 1))),
                    phase, random, counters);
    }
  }
  record.first.push_back(record.samples.size());
  return around.empty() ? 0 : around.front();
}

void MediumGather::look_nearby(MediumRecord& record, double first_stratum, RandomStream& random,
                               RayCounters& counters) const {
  const size_t samples =
      source_.exact() ? 1 : std::max(record.rays.size() / rays_per_constant_sample, least_constant_samples);
  for (size_t i = 0; i < samples; ++i)
    record.constant += Vec3d(source_.mean_radiance(record.x, record.medium, random, counters));
  record.constant /= static_cast<double>(samples);
  record.nearby.resize(record.rays.size());
  double squares = 0;
  for (size_t i = 0; i < record.rays.size(); ++i) {
    const double end = record.first_end(i);
    NearbySample& nearby = record.nearby[i];
    nearby.length = std::min(first_stratum, end);
    nearby.distance = std::min(first_stratum, near_share * end);
    nearby.source = Vec3d(source_at(record, i, nearby.distance, record.medium, random, counters));
    const Vec3d offset = record.rays[i].direction * nearby.distance;
    for (int c = 0; c < 3; ++c)
      record.slope[static_cast<size_t>(c)] += (nearby.source[c] - record.constant[c]) * offset;
    squares += glm::dot(offset, offset);
  }
  // Least squares, directions being uniform.
  for (Vec3d& slope : record.slope) slope *= squares > 0 ? 3 / squares : 0;
}

RadianceJet MediumGather::gather(const Vec3f& x, std::span<const MediumRay> rays,
                                 std::span<const std::array<uint32_t, 3>> triangles,
                                 std::span<const RayOutline> outlines, DerivativeOrder order,
                                 RandomStream& random, RayCounters& counters) const {
  RadianceJet result;
  if (rays.empty()) return result;
  MediumRecord record(world_, x, rays, triangles, outlines);
  const double first_stratum = march(record, random, counters);
  if (record.samples.empty()) return result;
  if (order != DerivativeOrder::value) {
    if (first_stratum > 0) look_nearby(record, first_stratum, random, counters);
    result = record.derivatives();
  }
  const Vec3d value = record.value();
  for (int c = 0; c < 3; ++c) {
    Jet3d& channel = result.channels[static_cast<size_t>(c)];
    channel.value = value[c];
    if (order == DerivativeOrder::gradient) channel.hessian = {};
    keep_finite(channel);
  }
  return result;
}

}  // namespace fogbank::derivatives
