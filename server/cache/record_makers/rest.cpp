#include "cache/record_makers/rest.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "derivatives/direction_grid.h"
#include "derivatives/path_source.h"
#include "derivatives/random_at.h"

namespace fogbank::cache {

namespace {

/// Random numbers are apart.
enum Repeat : uint32_t { surfaces_repeat, medium_repeat };

/// Directions towards surfaces, one sample or a few each, for one along which the medium is sampled: seven
/// times on average, besides what its derivatives cost. Surfaces lit in patches make most of the noise.
constexpr int32_t surface_share = 4;

derivatives::EstimatorSettings estimator_settings(const RecordMakerSettings& settings,
                                                  derivatives::Order order) {
  derivatives::EstimatorSettings result;
  result.order = order;
  result.emission = false;
  result.samples = settings.samples;
  if (order == derivatives::Order::single)
    result.samples = std::min(settings.samples, derivatives::EstimatorLimits::most_samples / surface_share) *
                     surface_share;
  result.repeats = 1;
  result.max_depth = settings.max_depth;
  result.seed = settings.seed;
  return result;
}

/// Variance of the mean of stratified samples, one a stratum, neighbours in the order being neighbours in
/// direction: half the squared difference of two neighbours estimates the variance of each, and counts what
/// differs between their strata as noise, which is on the safe side.
double variance_of_mean(std::span<const double> samples) {
  double sum = 0;
  for (size_t i = 0; i + 1 < samples.size(); i += 2)
    sum += (samples[i] - samples[i + 1]) * (samples[i] - samples[i + 1]);
  const auto count = static_cast<double>(samples.size());
  return count > 0 ? sum / (count * count) : 0;
}

/// Hessians are never taken for less than this share of themselves: extents would have no bound.
constexpr double least_hessian_share = 0.25;

/// Takes from derivatives what they are likely to owe to noise (James and Stein 1961, "Estimation with
/// quadratic loss": the multiple of an estimate with the least expected square error, with its own square for
/// the unknown one's): gradients that are noise mislead, Hessians that are make extents too small.
void shrink(derivatives::RadianceJet& jet, const derivatives::DerivativeVariance& variance) {
  const derivatives::Jet3d luminance = jet.luminance();
  const double gradient = glm::dot(luminance.gradient, luminance.gradient);
  const double hessian = luminance.hessian.norm() * luminance.hessian.norm();
  const double gradient_share = gradient > 0 ? std::max(1 - variance.gradient / gradient, 0.0) : 0;
  const double hessian_share =
      hessian > 0 ? std::max(1 - variance.hessian / hessian, least_hessian_share) : 0;
  for (derivatives::Jet3d& channel : jet.channels) {
    channel.gradient *= gradient_share;
    channel.hessian *= hessian_share;
  }
}

/// Nearest distance by direction of the lines of sight and of the outlines between them. Bins that none of
/// these falls into take what lines nearby found.
DepthBins depth_bins(const derivatives::SphereSamples& samples) {
  const derivatives::Sightlines& lines = samples.rays.lines();
  DepthBins bins;
  std::array<bool, DepthBins::count> seen{};
  for (size_t i = 0; i < lines.size(); ++i) {
    bins.insert(lines.direction(i), lines.distance(i));
    seen[DepthBins::bin(lines.direction(i))] = true;
  }
  for (const derivatives::Outline& outline : samples.outlines.points)
    bins.insert(outline.direction, outline.near_distance);
  // Half the spacing of lines to each side.
  const float reach = std::sqrt(pi / static_cast<float>(std::max<size_t>(lines.size(), 1)));
  for (size_t i = 0; i < lines.size(); ++i) {
    const Frame frame = Frame::from_normal(lines.direction(i));
    for (const Vec2f& offset : {Vec2f(reach, 0), Vec2f(-reach, 0), Vec2f(0, reach), Vec2f(0, -reach)}) {
      const Vec3f direction = frame.to_world({offset.x, offset.y, 1});
      if (!seen[DepthBins::bin(direction)]) bins.insert(direction, lines.distance(i));
    }
  }
  return bins;
}

/// Adds the mean over lines of sight of what arrives along them, times the harmonics of their directions.
void add_moments(const derivatives::SphereSamples& samples, const Vec3f& mean, HarmonicMoments& sum) {
  const derivatives::Sightlines& lines = samples.rays.lines();
  std::array<Vec3d, HarmonicMoments::colour_count> colour{};
  std::array<double, HarmonicMoments::grey_count> grey{};
  for (size_t i = 0; i < samples.light.size(); ++i) {
    const std::array<float, harmonic_count> harmonics = spherical_harmonics(lines.direction(i));
    for (size_t k = 0; k < colour.size(); ++k)
      colour[k] += static_cast<double>(harmonics[k]) * samples.light[i];
    for (size_t k = 0; k < grey.size(); ++k)
      grey[k] += static_cast<double>(harmonics[colour.size() + k]) * samples.arriving[i];
  }
  const auto unit = [&](float radiance) {
    const double total = static_cast<double>(radiance) * static_cast<double>(samples.light.size());
    return total > 0 ? 1 / total : 0;
  };
  for (size_t k = 0; k < colour.size(); ++k)
    for (int c = 0; c < 3; ++c) sum.colour[k][c] += static_cast<float>(colour[k][c] * unit(mean[c]));
  for (size_t k = 0; k < grey.size(); ++k) sum.grey[k] += static_cast<float>(grey[k] * unit(luminance(mean)));
}

}  // namespace

RestRecordMaker::RestRecordMaker(std::shared_ptr<const transport::World> world,
                                 const RecordMakerSettings& settings)
    : world_(std::move(world)),
      settings_(settings),
      surfaces_(world_, estimator_settings(settings, derivatives::Order::single)),
      medium_(world_, estimator_settings(settings, derivatives::Order::multiple)),
      kernel_(std::make_shared<transport::PathTracer>(
          world_, transport::PathSettings{.max_depth = settings.max_depth}, settings.photons)) {
  derivatives::validate(estimator_settings(settings, derivatives::Order::multiple));
}

uint64_t RestRecordMaker::id_of(const Wish& wish) const {
  return content_id(wish.position, wish.component,
                    "rest 2 " + std::to_string(settings_.samples) + ' ' +
                        std::to_string(settings_.max_depth) + ' ' + described(settings_.photons.get()),
                    settings_.seed);
}

Record RestRecordMaker::make(const Wish& wish, RayCounters& counters) const {
  if (settings_.photons) settings_.photons->complete(counters);
  const uint64_t rays_before = counters.total();
  derivatives::SphereSamples on_surfaces(*world_, surfaces_.plan());
  derivatives::SphereSamples in_medium(*world_, medium_.plan());
  const auto estimate_from = [&](const auto& source) {
    const derivatives::LightSources light{source, source};
    const int32_t medium = wish.component.medium;
    derivatives::RadianceJet sum =
        medium_.estimate_from(light, wish.position, medium, medium_repeat, in_medium, counters);
    shrink(sum, in_medium.medium_variance);
    sum += surfaces_.estimate_from(light, wish.position, medium, surfaces_repeat, on_surfaces, counters);
    return sum;
  };
  const derivatives::RadianceJet jet = estimate_from(derivatives::PathTracedSource(kernel_, record_depth));
  Record record;
  record.position = wish.position;
  record.component = wish.component;
  const derivatives::Jet3d luminance = jet.luminance();
  for (int c = 0; c < 3; ++c) {
    const derivatives::Jet3d& channel = jet.channels[static_cast<size_t>(c)];
    record.radiance[c] = std::fmax(static_cast<float>(channel.value), 0.0f);
    record.gradient[static_cast<size_t>(c)] = Vec3f(channel.gradient);
  }
  for (size_t i = 0; i < 6; ++i) record.hessian.entries[i] = static_cast<float>(luminance.hessian.entries[i]);
  record.samples = static_cast<uint32_t>(std::max<uint64_t>(counters.total() - rays_before, 1));
  record.variance =
      static_cast<float>(variance_of_mean(on_surfaces.arriving) + variance_of_mean(in_medium.arriving));
  if (has_shape(wish.component.quantity)) {
    HarmonicMoments moments;
    add_moments(on_surfaces, record.radiance, moments);
    add_moments(in_medium, record.radiance, moments);
    record.shape = DirectionalShape::from_moments(moments);
  }
  record.depth = depth_bins(on_surfaces.arriving.empty() ? in_medium : on_surfaces);
  record.id = id_of(wish);
  return record;
}

}  // namespace fogbank::cache
