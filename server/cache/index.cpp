#include "cache/index.h"

#include <algorithm>
#include <bit>

#include "cache/extents.h"
#include "derivatives/light_proxy.h"

namespace fogbank::cache {
namespace {

constexpr float greatest_value = 1e30f;
constexpr float greatest_growth = 3.0f;
/// Rejected records that are asked again by a ray.
constexpr uint32_t most_asked = 3;

/// Elements where `condition` holds, 0 elsewhere.
Float8 select(Int8 condition, Float8 values) {
  return std::bit_cast<Float8>(std::bit_cast<Int8>(values) & condition);
}

/// What a record says at each of eight offsets; linear extrapolation may still be negative.
std::array<Float8, 3> extrapolate(Quantity quantity, const Shading& shading, Float8 x, Float8 y, Float8 z) {
  using derivatives::multiply_add;
  std::array<Float8, 3> result;
  for (int channel = 0; channel < 3; ++channel) {
    const auto along = [&](size_t axis) { return broadcast(shading.derivatives[axis][channel]); };
    const float radiance = shading.radiance[channel];
    // Sums begin with the radiance where it is what is extrapolated.
    const bool linear = !is_unaware(quantity);
    const Float8 along_z = multiply_add<float>(along(2), z, broadcast(linear ? radiance : 0.0f));
    Float8& value = result[static_cast<size_t>(channel)];
    value = multiply_add<float>(along(0), x, multiply_add<float>(along(1), y, along_z));
    if (linear) continue;
    for (int lane = 0; lane < 8; ++lane) value[lane] = extrapolated(quantity, radiance, value[lane]);
  }
  return result;
}

/// w of a record at a squared distance of its extent < 1.
float weight_at(float square) {
  const float d = 1 - std::sqrt(square);
  return d * d * (3 - 2 * d);
}

}  // namespace

/// Of eight points.
struct Index::Sums {
  std::array<Float8, 3> radiance{};
  Float8 weight{};
  Float8 inverse_axes{};  ///< weights times sums of reciprocals of semi-axes
  Int8 records{};
  Int8 rejected{};
};

Index::Index(std::shared_ptr<const RecordSet> set, const ComponentRange& range,
             const MetricSettings& settings)
    : set_(std::move(set)), range_(&range), depth_guard_(settings.guards.depth) {
  const Quantity quantity = range.component.quantity;
  floor_ =
      quantity == Quantity::rest || quantity == Quantity::directional_rest || quantity == Quantity::irradiance
          ? static_cast<float>(settings.radiance_floor)
          : infinity;
  greatest_ = quantity == Quantity::ratio ? derivatives::LightProxy::most_ratio : greatest_value;
  const std::vector<Ellipsoid> ellipsoids = guarded_ellipsoids(*set_, range, settings);
  const auto is_cut = [](const Ellipsoid& ellipsoid) { return ellipsoid.gradient_share < 1; };
  // The rival extrapolates in full.
  if (!is_unaware(quantity) && std::ranges::any_of(ellipsoids, is_cut)) {
    gradient_shares_.reserve(ellipsoids.size());
    for (const Ellipsoid& ellipsoid : ellipsoids) gradient_shares_.push_back(ellipsoid.gradient_share);
  }
  tree_ = EllipsoidTree(set_->positions(range), range.place_count, [&](uint32_t i) { return ellipsoids[i]; });
}

Interpolation Index::look_up(const Vec3f& point, const ScatteredDirection* scattered) const {
  Interpolation result;
  look_up(std::span(&point, 1), std::span(&result, 1), scattered);
  return result;
}

void Index::look_up(std::span<const Vec3f> points, std::span<Interpolation> results,
                    const ScatteredDirection* scattered) const {
  for (size_t first = 0; first < points.size(); first += packet_size)
    look_up_bundle(points.subspan(first, std::min<size_t>(packet_size, points.size() - first)),
                   results.data() + first, scattered);
}

const Shading& Index::shading(size_t record, const ScatteredDirection* scattered, Shading& room) const {
  const Shading& stored = set_->shading()[record];
  const DirectionalShape* shape = scattered != nullptr ? set_->shape(*range_, record) : nullptr;
  if (shape == nullptr) return stored;
  const Spectrum share = scattered->share(*shape);
  room.radiance = share * stored.radiance;
  for (size_t axis = 0; axis < 3; ++axis) room.derivatives[axis] = share * stored.derivatives[axis];
  return room;
}

/// Of one point on a surface.
struct Index::SurfaceSums {
  Spectrum radiance{0};
  float inverse_axes = 0;  ///< weights times sums of reciprocals of the semi-axes along the surface
};

float Index::inverse_axes(uint32_t place) const {
  const Vec3f normal = set_->normal(*range_, place);
  if (normal == Vec3f(0)) return tree_.inverse_trace(place);
  const Vec3d across(normal);
  return tree_.inverse_trace(place) -
         static_cast<float>(glm::dot(across, tree_.inverse_root(place) * across));
}

Interpolation Index::look_up(const Vec3f& point, const Vec3f& normal) const {
  Interpolation result;
  SurfaceSums sums;
  tree_.search(set_->positions(*range_), PointBundle(std::span(&point, 1)),
               [&](const uint32_t* places, uint32_t count) {
                 for (uint32_t i = 0; i < count; ++i) add_on_surface(point, normal, places[i], result, sums);
               });
  if (result.weight > 0) {
    result.radiance = sums.radiance / result.weight;
    result.radius = 2 * result.weight / sums.inverse_axes;
  }
  return result;
}

Spectrum Index::ceiling(const Spectrum& radiance) const {
  return glm::min(greatest_growth * glm::max(radiance, Spectrum(floor_)), Spectrum(greatest_));
}

Vec3f Index::position(uint32_t place) const { return set_->position(*range_, place); }

float Index::normalised_square(uint32_t place, const Vec3f& offset, const Vec3f& normal) const {
  const float turn =
      normal == Vec3f(0) ? 0 : (1 - glm::dot(set_->normal(*range_, place), normal)) / (1 - similar_normals);
  return std::max(turn, 0.0f) +
         tree_.normalised_square(place, broadcast(offset.x), broadcast(offset.y), broadcast(offset.z))[0];
}

Spectrum Index::extrapolated_by(uint32_t place, const Vec3f& full_offset,
                                const ScatteredDirection* scattered) const {
  const Vec3f offset = gradient_share(place) * full_offset;
  const Quantity quantity = range_->component.quantity;
  Spectrum value(0);
  Spectrum centre(0);
  float total = 0;
  Shading room;
  for (size_t record = range_->first_record + range_->begin(place);
       record < range_->first_record + range_->end(place); ++record) {
    const auto samples = static_cast<float>(set_->samples(record));
    const Shading& said = shading(record, scattered, room);
    const Spectrum change =
        said.derivatives[0] * offset.x + said.derivatives[1] * offset.y + said.derivatives[2] * offset.z;
    Spectrum one = said.radiance + change;
    if (is_unaware(quantity))
      for (int channel = 0; channel < 3; ++channel)
        one[channel] = extrapolated(quantity, said.radiance[channel], change[channel]);
    total += samples;
    centre += samples * said.radiance;
    value += samples * one;
  }
  return glm::clamp(value / total, Spectrum(0), ceiling(centre / total));
}

void Index::add_on_surface(const Vec3f& point, const Vec3f& normal, uint32_t place, Interpolation& result,
                           SurfaceSums& sums) const {
  const Vec3f offset = point - position(place);
  const float square = normalised_square(place, offset, normal);
  if (!(square < 1)) return;
  for (size_t record = range_->first_record + range_->begin(place);
       record < range_->first_record + range_->end(place); ++record) {
    if (depth_guard_ && !set_->depth()[record].reaches(offset)) {
      ++result.rejected;
      return;
    }
  }
  const float weight = weight_at(square);
  sums.radiance += weight * extrapolated_by(place, offset);
  sums.inverse_axes += weight * inverse_axes(place);
  result.weight += weight;
  ++result.records;
}

std::vector<Contribution> Index::recovered(const Vec3f& point, const Vec3f& normal,
                                           const VisibilityTest& visibility) const {
  std::vector<Contribution> candidates;
  tree_.search(set_->positions(*range_), PointBundle(std::span(&point, 1)),
               [&](const uint32_t* places, uint32_t count) {
                 for (uint32_t i = 0; i < count; ++i) {
                   const float square = normalised_square(places[i], point - position(places[i]), normal);
                   const float weight = square < 1 ? weight_at(square) : 0;
                   if (weight > 0) candidates.push_back({places[i], weight, radius(places[i])});
                 }
               });
  const size_t asked = std::min<size_t>(candidates.size(), most_asked);
  std::ranges::partial_sort(candidates, candidates.begin() + static_cast<std::ptrdiff_t>(asked),
                            [](const Contribution& a, const Contribution& b) {
                              return a.weight != b.weight ? a.weight > b.weight : a.place < b.place;
                            });
  candidates.resize(asked);
  std::erase_if(candidates, [&](const Contribution& one) {
    return !visibility.reaches(position(one.place), set_->normal(*range_, one.place), point);
  });
  return candidates;
}

void Index::recover_visible(const Vec3f& point, const Vec3f& normal, const VisibilityTest& visibility,
                            Interpolation& found, const ScatteredDirection* scattered) const {
  if (found.weight > 0 || found.rejected == 0) return;
  const std::vector<Contribution> seen = recovered(point, normal, visibility);
  if (seen.empty()) return;
  Spectrum radiance(0);
  float inverse_radius = 0;
  for (const Contribution& one : seen) {
    radiance += one.weight * extrapolated_by(one.place, point - position(one.place), scattered);
    inverse_radius += one.weight / one.radius;
    found.weight += one.weight;
  }
  found.radiance = radiance / found.weight;
  found.radius = found.weight / inverse_radius;
  found.records = static_cast<uint32_t>(seen.size());
  found.rejected = std::min(found.rejected, most_asked) - found.records;
}

void Index::look_up_bundle(std::span<const Vec3f> points, Interpolation* results,
                           const ScatteredDirection* scattered) const {
  constexpr uint32_t most_packets = 28;  // one point touches about 14
  const PointBundle bundle(points);
  if (bundle.count > 1 && !tree_.touches_at_most(bundle, most_packets)) {
    const size_t half = points.size() / 2;
    look_up_bundle(points.first(half), results, scattered);
    look_up_bundle(points.subspan(half), results + half, scattered);
    return;
  }
  Sums sums;
  tree_.search(set_->positions(*range_), bundle, [&](const uint32_t* places, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) add(bundle, places[i], scattered, sums);
  });
  for (uint32_t lane = 0; lane < bundle.count; ++lane) {
    Interpolation& result = results[lane];
    result = {};
    result.weight = sums.weight[lane];
    result.records = static_cast<uint32_t>(sums.records[lane]);
    result.rejected = static_cast<uint32_t>(sums.rejected[lane]);
    if (result.weight > 0) {
      result.radiance =
          Spectrum(sums.radiance[0][lane], sums.radiance[1][lane], sums.radiance[2][lane]) / result.weight;
      result.radius = 3 * result.weight / sums.inverse_axes[lane];
    }
  }
}

void Index::add(const PointBundle& points, uint32_t place, const ScatteredDirection* scattered,
                Sums& sums) const {
  const PositionPacket& centres = set_->positions(*range_)[place / packet_size];
  const uint32_t place_lane = place % packet_size;
  const Float8 x = points.axes[0] - centres.at(0, place_lane);
  const Float8 y = points.axes[1] - centres.at(1, place_lane);
  const Float8 z = points.axes[2] - centres.at(2, place_lane);
  const Float8 square = tree_.normalised_square(place, x, y, z);
  Int8 holds = square < 1.0f;
  if (mask_of(holds) == 0) return;
  const size_t begin = range_->first_record + range_->begin(place);
  const size_t end = range_->first_record + range_->end(place);

  if (depth_guard_) {
    // Most extents end before the nearest surface in any direction: one byte tells, 64 others stay where they
    // are.
    const Float8 distance = square_root(x * x + y * y + z * z);
    const Int8 code = (std::bit_cast<Int8>(distance) >> DepthBins::mantissa_shift) - DepthBins::code_base;
    for (size_t record = begin; record < end; ++record) {
      const Int8 doubtful = holds & (code >= int32_t{set_->nearest()[record]});
      for (uint32_t lanes = mask_of(doubtful); lanes != 0; lanes &= lanes - 1) {
        const int lane = std::countr_zero(lanes);
        if (set_->depth()[record].reaches({x[lane], y[lane], z[lane]})) continue;
        holds[lane] = 0;
        ++sums.rejected[lane];
      }
    }
  }
  sums.records -= holds;

  const Float8 d = 1.0f - square_root(square);
  const Float8 weight = select(holds, d * d * (3.0f - 2.0f * d));
  const float share = gradient_share(place);
  const auto extrapolated_from = [&](const Shading& said) {
    return extrapolate(range_->component.quantity, said, share * x, share * y, share * z);
  };
  std::array<Float8, 3> value;
  Spectrum centre(0);
  Shading room;
  if (end == begin + 1) {
    const Shading& said = shading(begin, scattered, room);
    centre = said.radiance;
    value = extrapolated_from(said);
  } else {
    value = {};
    float total = 0;
    for (size_t record = begin; record < end; ++record) {
      const auto samples = static_cast<float>(set_->samples(record));
      total += samples;
      const Shading& said = shading(record, scattered, room);
      centre += samples * said.radiance;
      const std::array<Float8, 3> one = extrapolated_from(said);
      for (size_t channel = 0; channel < 3; ++channel) value[channel] += samples * one[channel];
    }
    for (Float8& channel : value) channel /= total;
    centre /= total;
  }
  const Spectrum most = ceiling(centre);
  for (size_t channel = 0; channel < 3; ++channel) {
    const Float8 clamped =
        lesser(greater(value[channel], Float8{}), broadcast(most[static_cast<int>(channel)]));
    sums.radiance[channel] += weight * clamped;
  }
  sums.weight += weight;
  sums.inverse_axes += weight * tree_.inverse_trace(place);
}

std::vector<Contribution> Index::contributions(const Vec3f& point, const Vec3f& normal) const {
  std::vector<Contribution> result;
  const PointBundle bundle(std::span(&point, 1));
  tree_.search(set_->positions(*range_), bundle, [&](const uint32_t* places, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) {
      float weight = 0;
      if (normal == Vec3f(0)) {
        Sums sums;
        add(bundle, places[i], nullptr, sums);
        weight = sums.weight[0];
      } else {
        Interpolation one;
        SurfaceSums sums;
        add_on_surface(point, normal, places[i], one, sums);
        weight = one.weight;
      }
      if (weight > 0) result.push_back({places[i], weight, radius(places[i])});
    }
  });
  return result;
}

float Index::radius(uint32_t place) const {
  const float sum = inverse_axes(place);
  const bool on_surface = set_->normal(*range_, place) != Vec3f(0);
  return sum > 0 ? (on_surface ? 2 : 3) / sum : 0.0f;
}

Epoch::Epoch(std::shared_ptr<const RecordSet> set, const MetricSettings& settings)
    : set_(std::move(set)), settings_(settings) {
  validate(settings);
  indices_.reserve(set_->components().size());
  for (const ComponentRange& range : set_->components()) indices_.emplace_back(set_, range, settings);
}

const Index* Epoch::find(const Component& component) const {
  const auto found = std::lower_bound(
      indices_.begin(), indices_.end(), component,
      [](const Index& index, const Component& wanted) { return index.component() < wanted; });
  return found != indices_.end() && found->component() == component ? &*found : nullptr;
}

size_t Epoch::memory() const {
  size_t bytes = set_->memory();
  for (const Index& index : indices_) bytes += index.memory() + sizeof(Index);
  return bytes;
}

}  // namespace fogbank::cache
