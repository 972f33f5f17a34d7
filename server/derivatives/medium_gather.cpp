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
/// The first stratum around the point is parted here, so that its outer part has a sample of its own.
constexpr double near_share = 0.7;
/// Samples stop short of the surfaces and boundaries that end a stretch by this share of the way, or rounding
/// would put some of them behind.
constexpr double inside_share = 1 - 1e-4;
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

void MediumGather::march_stretch(MediumRecord& record, size_t ray, size_t index, std::span<const double> ends,
                                 double phase) const {
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
  const auto place = [&](double begin, double end, size_t stratum, bool near) {
    // Rays out of step: what a march with coarse strata misses then differs from ray to ray and cancels,
    // instead of being an error common to them all.
    const double turned =
        phase + static_cast<double>(stratum) * stratum_turn + static_cast<double>(ray) * ray_turn;
    const DistanceSample drawn = sample_stratum(sigma_t, begin, end, turned - std::floor(turned));
    const double within = std::min(drawn.distance, length * inside_share);
    const MediumSample sample{
        stretch.begin + within, static_cast<uint32_t>(index), near,
        before * Vec3d(medium.sigma_s) * transmittances(sigma_t, within) * drawn.inverse_pdf, Vec3d(0)};
    if (sample.weight == Vec3d(0)) return;
    record.samples.push_back(sample);
    if (near) record.nearby[ray] = {sample.distance, end, Vec3d(0)};
  };
  double begin = 0;
  for (size_t k = 0; k < ends.size() && begin < length; ++k) {
    const double end = std::min(ends[k], length);
    const bool near = index == 0 && k == 0;
    if (near) {
      place(0, near_share * end, ends.size(), true);
      begin = near_share * end;
    }
    place(begin, end, k, near);
    begin = end;
  }
}

void MediumGather::look(MediumRecord& record, size_t ray, size_t first, RandomStream& random,
                        RayCounters& counters) const {
  const MediumRay& line = record.rays[ray];
  for (MediumSample& sample : std::span(record.samples).subspan(first)) {
    const transport::MediumLight light =
        source_.light(record.x + Vec3f(line.direction * sample.distance), Vec3f(line.direction),
                      line.stretches[sample.stretch].medium, random, counters);
    sample.source = Vec3d(light.mean);
    sample.scattered = Vec3d(light.scattered);
    if (sample.near) record.nearby[ray].source = sample.source;
  }
}

void MediumGather::march(MediumRecord& record, RandomStream& random, RayCounters& counters) const {
  const auto phase = static_cast<double>(random.next_float());
  double extent = 0;
  double mean_extent = 0;
  for (size_t i = 0; i < record.rays.size(); ++i) {
    extent = std::max(extent, record.first_end(i));
    mean_extent += record.first_end(i) / static_cast<double>(record.rays.size());
  }
  const double densest = std::max({record.sigma_t.x, record.sigma_t.y, record.sigma_t.z});
  std::vector<double> around;
  if (record.sigma_s != Vec3d(0)) {
    around = source_.exact()
                 ? marching_strata(record.sigma_t, extent, settings_.optical_step, settings_.steps)
                 : importance_strata(
                       record.sigma_t, extent,
                       std::min(settings_.noisy_first * mean_extent, settings_.optical_step / densest),
                       settings_.noisy_strata);
    record.nearby.resize(record.rays.size());
  }
  for (size_t i = 0; i < record.rays.size(); ++i) {
    counters.poll_at(i);
    record.first.push_back(record.samples.size());
    const std::vector<MediumStretch>& stretches = record.rays[i].stretches;
    if (!around.empty()) march_stretch(record, i, 0, around, phase);
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
                        : importance_strata(sigma_t, length, 0,
                                            1 + static_cast<int>(share * (settings_.noisy_strata - 1))),
                    phase);
    }
    look(record, i, record.first.back(), random, counters);
  }
  record.first.push_back(record.samples.size());
}

void MediumGather::subtract_linear_source(MediumRecord& record, RandomStream& random,
                                          RayCounters& counters) const {
  // Least squares over the samples around the point, directions being uniform: the source's value there, as
  // the intercept over the square of the distance (its mean over directions has no other term of low order),
  // and its gradient.
  double count = 0;
  std::array<double, 2> powers{};  // of the squared distance
  std::array<Vec3d, 2> sums{Vec3d(0), Vec3d(0)};
  counters.poll();
  for (const MediumSample& sample : record.samples) {
    if (!sample.near) continue;
    const double square = sample.distance * sample.distance;
    ++count;
    powers[0] += square;
    powers[1] += square * square;
    sums[0] += sample.source;
    sums[1] += square * sample.source;
  }
  if (source_.exact()) {
    record.constant = Vec3d(source_.mean_radiance(record.x, record.medium, random, counters));
  } else {
    const double determinant = count * powers[1] - powers[0] * powers[0];
    record.constant = determinant > 0 ? (powers[1] * sums[0] - powers[0] * sums[1]) / determinant
                                      : sums[0] / std::max(count, 1.0);
  }
  double squares = 0;
  for (size_t i = 0; i < record.rays.size(); ++i) {
    const NearbySample& nearby = record.nearby[i];
    const Vec3d offset = record.rays[i].direction * nearby.distance;
    for (int c = 0; c < 3; ++c)
      record.slope[static_cast<size_t>(c)] += (nearby.source[c] - record.constant[c]) * offset;
    squares += glm::dot(offset, offset);
  }
  for (Vec3d& slope : record.slope) slope *= squares > 0 ? 3 / squares : 0;
}

RadianceJet MediumGather::gather(const Vec3f& x, std::span<const MediumRay> rays,
                                 std::span<const std::array<uint32_t, 3>> triangles,
                                 std::span<const RayOutline> outlines, DerivativeOrder order,
                                 RandomStream& random, RayCounters& counters, std::span<Vec3d> arriving,
                                 DerivativeVariance* variance) const {
  RadianceJet result;
  if (rays.empty()) return result;
  MediumRecord record(world_, x, rays, triangles, outlines);
  march(record, random, counters);
  if (record.samples.empty()) return result;
  if (order != DerivativeOrder::value) {
    if (!record.nearby.empty()) subtract_linear_source(record, random, counters);
    DerivativeVariance spread;
    result = record.derivatives(spread, counters);
    if (variance != nullptr) {
      variance->gradient += spread.gradient;
      variance->hessian += spread.hessian;
    }
  }
  for (size_t i = 0; i < arriving.size(); ++i) arriving[i] = record.value_along(i);
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
