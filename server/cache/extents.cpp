#include "cache/extents.h"

#include <tbb/parallel_for.h>

#include <atomic>
#include <cmath>

#include "cache/neighbour_clamp.h"

namespace fogbank::cache {
namespace {

/// What verifying needs of a place.
struct Field {
  Quantity quantity;
  Vec3f position;
  Vec3f normal;
  float radiance;  ///< luminance
  Vec3f gradient;  ///< of the luminance
  float variance;
  float proxy;  ///< of ratios; 1 for others
};

Field field_of(const Place& place) {
  Vec3f gradient;
  for (int axis = 0; axis < 3; ++axis)
    gradient[axis] = luminance({place.gradient[0][axis], place.gradient[1][axis], place.gradient[2][axis]});
  return {place.quantity,
          place.position,
          place.normal,
          luminance(place.radiance),
          gradient,
          place.variance,
          place.quantity == Quantity::ratio ? place.proxy : 1.0f};
}

void lower(float& value, float candidate) {
  // The minimum is the same in whichever order threads come.
  std::atomic_ref<float> shared(value);
  float seen = shared.load(std::memory_order_relaxed);
  while (candidate < seen && !shared.compare_exchange_weak(seen, candidate, std::memory_order_relaxed)) {
  }
}

bool reaches(const RecordSet& set, const ComponentRange& range, uint32_t place, const Vec3f& offset) {
  for (uint32_t record = range.begin(place); record < range.end(place); ++record)
    if (!set.depth()[range.first_record + record].reaches(offset)) return false;
  return true;
}

double tolerance_of(const MetricSettings& settings, const Ellipsoid& ellipsoid, const Field& field) {
  if (is_unaware(field.quantity)) return std::max(settings.first_order_change, 0.005);
  return field.normal != Vec3f(0) ? verify_tolerance_on_surface(surface_threshold(settings), ellipsoid)
                                  : verify_tolerance(settings.threshold, ellipsoid);
}

/// Guard 3: factor of each ellipsoid.
std::vector<float> verified_scales(const RecordSet& set, const ComponentRange& range,
                                   const MetricSettings& settings, const std::vector<Field>& fields,
                                   const std::vector<Ellipsoid>& ellipsoids) {
  const std::span<const PositionPacket> positions = set.positions(range);
  const EllipsoidTree tree(positions, range.place_count, [&](uint32_t i) { return ellipsoids[i]; });
  std::vector<float> scales(range.place_count, 1.0f);
  tbb::parallel_for(uint32_t{0}, range.place_count, [&](uint32_t j) {
    const Field& probe = fields[j];
    // Predictions of a ratio count by what they make of the proxy at the probe.
    const auto proxy = static_cast<double>(probe.proxy);
    const double probe_reference = reference_radiance(settings, static_cast<double>(probe.radiance) * proxy);
    tree.search(
        positions, PointBundle(std::span(&probe.position, 1)), [&](const uint32_t* found, uint32_t count) {
          for (uint32_t n = 0; n < count; ++n) {
            const uint32_t i = found[n];
            if (i == j) continue;
            const Field& record = fields[i];
            if (record.normal != Vec3f(0) && glm::dot(record.normal, probe.normal) < similar_normals)
              continue;
            const Vec3f offset = probe.position - record.position;
            const float square =
                tree.normalised_square(i, broadcast(offset.x), broadcast(offset.y), broadcast(offset.z))[0];
            if (!(square < 1)) continue;
            if (settings.guards.depth && !reaches(set, range, i, offset)) continue;
            const float predicted =
                extrapolated(record.quantity, record.radiance, glm::dot(record.gradient, offset));
            const double error =
                std::fabs(static_cast<double>(predicted) - static_cast<double>(probe.radiance)) * proxy;
            const double reference =
                std::max(reference_radiance(settings, static_cast<double>(record.radiance * record.proxy)),
                         probe_reference);
            // Two standard deviations are left to noise: what it explains is no contradiction.
            const double noise =
                2 * proxy *
                std::sqrt(static_cast<double>(record.variance) + static_cast<double>(probe.variance));
            const double tolerance = tolerance_of(settings, ellipsoids[i], record) * reference + noise;
            if (error > tolerance)
              lower(scales[i],
                    std::sqrt(square) * std::max(static_cast<float>(std::sqrt(tolerance / error)), 0.5f));
          }
        });
  });
  return scales;
}

}  // namespace

double verify_tolerance(double threshold, const Ellipsoid& ellipsoid) {
  double product = 1;
  for (const float a : ellipsoid.semi_axes) product *= static_cast<double>(a);
  constexpr double pi_double = 3.14159265358979323846;
  return std::max(15 * threshold / (4 * pi_double * product), 0.005);
}

double verify_tolerance_on_surface(double threshold, const Ellipsoid& ellipsoid) {
  constexpr double pi_double = 3.14159265358979323846;
  const double product =
      static_cast<double>(ellipsoid.semi_axes[0]) * static_cast<double>(ellipsoid.semi_axes[1]);
  return std::max(4 * threshold / (pi_double * product), 0.005);
}

std::vector<Ellipsoid> guarded_ellipsoids(const RecordSet& set, const ComponentRange& range,
                                          const MetricSettings& common) {
  MetricSettings settings = common;
  if (range.component.quantity == Quantity::ratio) settings.radiance_floor = common.direct_floor;
  std::vector<Ellipsoid> ellipsoids(range.place_count);
  std::vector<Field> fields(range.place_count);
  std::vector<float> minima(range.place_count);
  std::vector<float> bounds(range.place_count);
  tbb::parallel_for(uint32_t{0}, range.place_count, [&](uint32_t i) {
    const Place place = set.place(range, i);
    ellipsoids[i] = base_ellipsoid(settings, place);
    fields[i] = field_of(place);
    minima[i] = minimum_radius(settings, place.position);
    bounds[i] = std::max(ellipsoids[i].longest(), minima[i]);
  });
  if (settings.guards.neighbour_clamp) bounds = neighbour_clamp(set.positions(range), bounds);
  std::vector<float> scales(range.place_count, 1.0f);
  if (settings.guards.verify) scales = verified_scales(set, range, settings, fields, ellipsoids);
  for (uint32_t i = 0; i < range.place_count; ++i) {
    Ellipsoid& ellipsoid = ellipsoids[i];
    const bool on_surface = fields[i].normal != Vec3f(0);
    const float shortest =
        on_surface ? std::min(ellipsoid.semi_axes[0], ellipsoid.semi_axes[1]) : ellipsoid.shortest();
    const float granted = std::min(shortest * scales[i], bounds[i]);
    ellipsoid = ellipsoid.clamped(scales[i], bounds[i], minima[i]);
    if (granted < minima[i]) ellipsoid.gradient_share = granted / minima[i];
    if (on_surface) ellipsoid = ellipsoid.flat();
  }
  return ellipsoids;
}

}  // namespace fogbank::cache
