#include "integrators/radiance_cache_pilot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "cache/eigen.h"
#include "integrators/radiance_cache.h"

namespace fogbank::integrators {

namespace {

constexpr uint32_t places_per_medium = 16;
constexpr uint32_t most_media = 16;
/// Points of the medium's box that are tried before a place is given up.
constexpr uint32_t most_tries = 64;
/// Stream of random numbers apart from the image's and the records'.
constexpr uint32_t pilot_stream = 2;
/// Of the mean over the pilot (method.md section 10.3).
constexpr double floor_share = 0.05;
/// Of the greatest radius, where no record tells.
constexpr double default_share = 0.4;
constexpr double least_radiance = 1e-30;

/// Mean of the absolute eigenvalues of the Hessian; for the rival, which has none, that of an exponential
/// with the record's length of change.
double mean_curvature(const cache::Record& record) {
  if (cache::is_unaware(record.component.quantity)) {
    const auto length = static_cast<double>(record.proxy);
    return static_cast<double>(luminance(record.radiance)) / (length * length);
  }
  Symmetric3d hessian;
  for (size_t i = 0; i < hessian.entries.size(); ++i)
    hessian.entries[i] = static_cast<double>(record.hessian.entries[i]);
  const cache::Eigensystem<3> system = cache::eigen_decomposition(hessian);
  double sum = 0;
  for (const double value : system.values) sum += std::fabs(value);
  return sum / 3;
}

}  // namespace

CachePilot::CachePilot(std::shared_ptr<const transport::World> world, const CacheTechnique& technique)
    : world_(std::move(world)) {
  const auto media = static_cast<int32_t>(world_->scene().media.size());
  for (int32_t medium = 0; medium < media && components_.size() < most_media; ++medium)
    if (const std::optional<cache::Quantity> rest = technique.rest(world_->medium(medium)))
      components_.push_back({medium, 0, 0, *rest});
  if (world_->scene().bounds.radius > 0) records_.resize(components_.size() * places_per_medium);
}

const cache::Component& CachePilot::component(uint32_t number) const {
  return components_[number / places_per_medium];
}

std::optional<Vec3f> CachePilot::place(uint32_t number) const {
  const int32_t medium = component(number).medium;
  const transport::Extent& extent = world_->medium(medium).extent;
  const scene::BoundingSphere& ball = world_->scene().bounds;
  const Vec3f lower = glm::max(extent.lower, ball.center - ball.radius);
  const Vec3f upper = glm::min(extent.upper, ball.center + ball.radius);
  RandomStream random(0, number, 0, 0, pilot_stream);
  for (uint32_t i = 0; i < most_tries; ++i) {
    Vec3f point;
    for (int axis = 0; axis < 3; ++axis)
      point[axis] = lower[axis] + random.next_float() * (upper[axis] - lower[axis]);
    if (world_->medium_at(point) == medium) return point;
  }
  return std::nullopt;
}

void CachePilot::recall(const cache::RecordSet& set) {
  for (const cache::ComponentRange& range : set.components()) {
    const auto known = std::ranges::find(components_, range.component);
    if (known == components_.end()) continue;
    const auto first = static_cast<uint32_t>(known - components_.begin()) * places_per_medium;
    std::map<std::array<float, 3>, uint32_t> wanted;
    for (uint32_t number = first; number < first + places_per_medium; ++number)
      if (const std::optional<Vec3f> position = place(number))
        wanted[{position->x, position->y, position->z}] = number;
    for (uint32_t i = 0; i < range.place_count; ++i) {
      const Vec3f position = set.position(range, i);
      const auto found = wanted.find({position.x, position.y, position.z});
      if (found == wanted.end()) continue;
      size_t fewest = range.first_record + range.begin(i);
      for (size_t record = fewest; record < range.first_record + range.end(i); ++record)
        if (set.samples(record) < set.samples(fewest)) fewest = record;
      records_[found->second] = set.record(fewest);
    }
  }
}

void CachePilot::make(uint32_t number, const cache::RecordMaker& maker, RayCounters& counters) {
  if (records_[number]) return;
  const std::optional<Vec3f> position = place(number);
  if (!position) return;
  records_[number] = maker.make({*position, Vec3f(0), component(number)}, counters);
}

std::optional<cache::Record> CachePilot::take_record(cache::ByteReader& bytes, uint32_t number) const {
  std::optional<cache::Record> record = cache::take_optional_record(bytes);
  if (record && record->component != component(number))
    cache::refuse_poisoned("a record of the pilot is of another component");
  return record;
}

std::vector<cache::Record> CachePilot::records() const {
  std::vector<cache::Record> result;
  for (const std::optional<cache::Record>& record : records_)
    if (record) result.push_back(*record);
  return result;
}

PilotedMetric CachePilot::metric(double border_error, double maximum_radius) const {
  const std::vector<cache::Record> pilot = records();
  PilotedMetric result;
  double mean = 0;
  for (const cache::Record& record : pilot) mean += static_cast<double>(luminance(record.radiance));
  mean /= static_cast<double>(std::max<size_t>(pilot.size(), 1));
  result.radiance_floor = std::max(floor_share * mean, least_radiance);

  // Where linear extrapolation errs by that in a field exp(r / length of change), the radiance has changed by
  // so much.
  result.first_order_change = std::sqrt(2 * border_error);
  // Of a ball of radius R in a field of three equal curvatures lambda the error integral is 2 pi / 5 lambda
  // R^5, that at its border lambda R^2 / 2 (method.md section 10.1).
  double logarithms = 0;
  for (const cache::Record& record : pilot) {
    const double curvature = mean_curvature(record);
    const double radiance = std::max(static_cast<double>(luminance(record.radiance)), result.radiance_floor);
    logarithms += std::log(std::clamp(std::sqrt(2 * border_error * radiance / curvature),
                                      1e-3 * maximum_radius, maximum_radius));
  }
  const double radius =
      !(mean > 0) ? default_share * maximum_radius : std::exp(logarithms / static_cast<double>(pilot.size()));
  constexpr double pi_double = 3.14159265358979323846;
  result.threshold = 4 * pi_double / 5 * border_error * radius * radius * radius;
  result.typical_radius = static_cast<float>(radius);
  return result;
}

}  // namespace fogbank::integrators
