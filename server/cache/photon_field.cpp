#include "cache/photon_field.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "core/sampling.h"
#include "scene/intersector.h"

namespace fogbank::cache {

namespace {

/// Cells along the longest side of a medium's box.
constexpr int32_t most_cells = 48;
constexpr uint32_t field_stream = 0x6669656C;
/// Parts that the photons are traced in, each with sums of its own.
constexpr uint32_t share_count = 16;
/// Light that is less of a beam's than this is dropped.
constexpr float negligible_depth = 14;
enum Clarity : uint8_t { unknown, clear_cell, crossed_cell };

/// Where a path begins: points of a Kronecker sequence lie evenly over the emitters, noise of all light
/// together would be seen everywhere. Its steps are powers of the inverse root of x^6 = x + 1 (Roberts 2018,
/// "The Unreasonable Effectiveness of Quasirandom Sequences"), times 2^32.
transport::EmissionPoint emission_point(uint32_t path) {
  constexpr std::array<uint32_t, transport::emission_dimensions> steps{0xE19B01ABu, 0xC6D1D6C9u, 0xAF36D01Fu,
                                                                       0x9A69443Fu, 0x881403B9u};
  transport::EmissionPoint point;
  for (size_t i = 0; i < point.size(); ++i) point[i] = static_cast<float>((path * steps[i]) >> 8) * 0x1p-24f;
  return point;
}

}  // namespace

PhotonField::PhotonField(std::shared_ptr<const transport::World> world, uint32_t paths, int32_t max_depth)
    : world_(std::move(world)),
      paths_(paths),
      emission_(*world_),
      tracer_(world_, transport::PathSettings{.max_depth = max_depth}) {
  const scene::BoundingSphere& ball = world_->scene().bounds;
  grids_.reserve(world_->scene().media.size());
  for (size_t i = 0; i < world_->scene().media.size(); ++i) {
    const transport::MediumInfo& medium = world_->medium(static_cast<int32_t>(i));
    Grid& grid = grids_.emplace_back();
    if (!medium.phase.is_isotropic() || is_black(medium.sigma_s) || !(ball.radius > 0)) continue;
    const Vec3f lower = glm::max(medium.extent.lower, ball.center - ball.radius);
    const Vec3f upper = glm::min(medium.extent.upper, ball.center + ball.radius);
    const Vec3f sides = upper - lower;
    const float longest = std::max({sides.x, sides.y, sides.z});
    if (!(std::min({sides.x, sides.y, sides.z}) > 0)) continue;
    grid.lower = lower;
    grid.cell = longest / most_cells;
    for (int axis = 0; axis < 3; ++axis)
      grid.size[axis] = std::clamp(static_cast<int32_t>(std::ceil(sides[axis] / grid.cell)), 1, most_cells);
    const size_t cells = grid.number(grid.size - 1) + 1;
    grid.radiance.assign(cells, Spectrum(0));
    grid.clear = std::vector<std::atomic<uint8_t>>(cells);
  }
  shares_.assign(share_count, Share::open);
  traced_.resize(share_count);
}

void PhotonField::splat(const transport::PhotonBeam& beam, const Grid& grid, Sums& sums) const {
  const transport::MediumInfo& medium = world_->medium(beam.medium);
  const Spectrum rate = medium.sigma_t - transport::PhotonTracer::end_rate(medium);
  float least_rate = infinity;
  for (int c = 0; c < 3; ++c)
    if (beam.flux[c] > 0) least_rate = std::fmin(least_rate, rate[c]);
  float begin = 0;
  float end = std::fmin(beam.length, least_rate > 0 ? negligible_depth / least_rate : infinity);
  const Vec3f origin = (beam.origin - grid.lower) / grid.cell;
  const Vec3f direction = beam.direction / grid.cell;
  for (int axis = 0; axis < 3; ++axis) {
    const auto side = static_cast<float>(grid.size[axis]);
    if (direction[axis] == 0) {
      if (origin[axis] < 0 || origin[axis] >= side) return;
      continue;
    }
    const float a = -origin[axis] / direction[axis];
    const float b = (side - origin[axis]) / direction[axis];
    begin = std::fmax(begin, std::fmin(a, b));
    end = std::fmin(end, std::fmax(a, b));
  }
  if (!(begin < end)) return;
  glm::ivec3 cell;
  glm::ivec3 step;
  Vec3f next;
  for (int axis = 0; axis < 3; ++axis) {
    const float at = origin[axis] + begin * direction[axis];
    cell[axis] = std::clamp(static_cast<int32_t>(std::floor(at)), 0, grid.size[axis] - 1);
    step[axis] = direction[axis] < 0 ? -1 : 1;
    next[axis] =
        direction[axis] == 0
            ? infinity
            : (static_cast<float>(cell[axis] + (step[axis] > 0 ? 1 : 0)) - origin[axis]) / direction[axis];
  }
  const auto kept = [&](float t) {
    return Spectrum(std::exp(-rate.x * t), std::exp(-rate.y * t), std::exp(-rate.z * t));
  };
  float t = begin;
  Spectrum before = kept(t);
  while (t < end) {
    const int axis = next.x < next.y ? (next.x < next.z ? 0 : 2) : (next.y < next.z ? 1 : 2);
    const float out = std::fmin(std::fmax(next[axis], t), end);
    const Spectrum after = kept(out);
    // The mean of an exponential over a short way, by its ends.
    sums[grid.number(cell)] += beam.flux * (0.5f * (out - t)) * (before + after);
    before = after;
    t = out;
    cell[axis] += step[axis];
    if (cell[axis] < 0 || cell[axis] >= grid.size[axis]) return;
    next[axis] += std::fabs(1 / direction[axis]);
  }
}

std::vector<PhotonField::Sums> PhotonField::trace(uint32_t share, RayCounters& counters) const {
  std::vector<Sums> sums(grids_.size());
  for (size_t i = 0; i < grids_.size(); ++i) sums[i].assign(grids_[i].radiance.size(), Spectrum(0));
  const auto path_of = [&](uint32_t number) {
    return static_cast<uint32_t>(uint64_t{number} * paths_ / share_count);
  };
  transport::Photons photons;
  for (uint32_t path = path_of(share); path < path_of(share + 1); ++path) {
    counters.poll();
    RandomStream random(0, path, 0, 0, field_stream);
    std::optional<transport::EmittedRay> ray = emission_.sample(emission_point(path));
    if (!ray) continue;
    ray->flux /= static_cast<float>(paths_);
    photons.beams.clear();
    photons.on_surfaces.clear();
    tracer_.trace(*ray, path, random, counters, photons);
    for (const transport::PhotonBeam& beam : photons.beams) {
      const auto medium = static_cast<size_t>(beam.medium);
      if (beam.depth > 0 && !grids_[medium].radiance.empty()) splat(beam, grids_[medium], sums[medium]);
    }
  }
  return sums;
}

void PhotonField::complete(RayCounters& counters) {
  if (complete_.load(std::memory_order_acquire)) return;
  std::unique_lock lock(mutex_);
  while (!complete_.load(std::memory_order_relaxed)) {
    const auto open = std::ranges::find(shares_, Share::open);
    if (open == shares_.end()) {
      // Others are at work on the rest; whoever doesn't want it any more need not wait for them.
      changed_.wait_for(lock, std::chrono::milliseconds(20));
      counters.poll();
      continue;
    }
    const auto share = static_cast<uint32_t>(open - shares_.begin());
    *open = Share::taken;
    lock.unlock();
    try {
      // Rays are counted apart: those of a record say how much it is worth, whoever traces the photons.
      RayCounters own = counters;
      std::vector<Sums> sums = trace(share, own);
      lock.lock();
      traced_[share] = std::move(sums);
    } catch (...) {
      lock.lock();
      shares_[share] = Share::open;
      changed_.notify_all();
      throw;
    }
    shares_[share] = Share::traced;
    if (std::ranges::all_of(shares_, [](Share one) { return one == Share::traced; })) {
      finish();
      complete_.store(true, std::memory_order_release);
    }
    changed_.notify_all();
  }
}

void PhotonField::finish() {
  for (const std::vector<Sums>& sums : traced_)
    for (size_t i = 0; i < sums.size(); ++i)
      for (size_t cell = 0; cell < sums[i].size(); ++cell) grids_[i].radiance[cell] += sums[i][cell];
  traced_ = {};
  for (Grid& grid : grids_) {
    const float volume = grid.cell * grid.cell * grid.cell;
    for (Spectrum& radiance : grid.radiance) {
      radiance *= inv_4pi / volume;
      if (!is_finite(radiance)) radiance = Spectrum(0);
    }
  }
}

bool PhotonField::is_clear(const Grid& grid, const glm::ivec3& cell, int32_t medium) const {
  std::atomic<uint8_t>& known = grid.clear[grid.number(cell)];
  if (const uint8_t state = known.load(std::memory_order_relaxed); state != unknown)
    return state == clear_cell;
  const Vec3f lower = grid.lower + grid.cell * Vec3f(cell);
  const Vec3f middle = lower + 0.5f * grid.cell;
  // Middle lines and diagonals.
  constexpr std::array<std::array<float, 3>, 7> lines{
      {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}, {1, 1, -1}, {1, -1, 1}, {1, -1, -1}}};
  bool clear = world_->medium_at(middle) == medium;
  for (size_t i = 0; clear && i < lines.size(); ++i) {
    const Vec3f along = grid.cell * Vec3f(lines[i][0], lines[i][1], lines[i][2]);
    const float length = glm::length(along);
    scene::Hit hit;
    clear = !world_->scene().intersector->intersect({middle - 0.5f * along, along / length, length}, hit);
  }
  known.store(clear ? clear_cell : crossed_cell, std::memory_order_relaxed);
  return clear;
}

std::optional<Spectrum> PhotonField::scattered_before(const Vec3f& y, int32_t medium) const {
  const Grid& grid = grids_[static_cast<size_t>(medium)];
  if (grid.radiance.empty()) return std::nullopt;
  const Vec3f at = (y - grid.lower) / grid.cell - 0.5f;
  const Vec3f floor = glm::floor(at);
  const glm::ivec3 first(floor);
  if (glm::any(glm::lessThan(first, glm::ivec3(0))) || glm::any(glm::greaterThanEqual(first + 1, grid.size)))
    return std::nullopt;
  const Vec3f share = at - floor;
  Spectrum sum(0);
  for (int corner = 0; corner < 8; ++corner) {
    const glm::ivec3 offset(corner & 1, (corner >> 1) & 1, corner >> 2);
    const glm::ivec3 cell = first + offset;
    if (!is_clear(grid, cell, medium)) return std::nullopt;
    float weight = 1;
    for (int axis = 0; axis < 3; ++axis) weight *= offset[axis] == 1 ? share[axis] : 1 - share[axis];
    sum += weight * grid.radiance[grid.number(cell)];
  }
  return sum;
}

std::string described(const PhotonField* photons) {
  return photons == nullptr ? "paths" : std::to_string(photons->paths()) + " aimed photons";
}

}  // namespace fogbank::cache
