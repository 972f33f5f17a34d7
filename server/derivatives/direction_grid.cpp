#include "derivatives/direction_grid.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <mutex>
#include <numbers>
#include <numeric>

namespace fogbank::derivatives {

namespace {

constexpr int32_t least_side = 4;
constexpr int32_t greatest_side = 1024;
/// Share of a cell's side that a direction may fall into, around the middle.
constexpr double jitter = 0.5;
/// Between two looks at whether the topology that another thread builds is wanted still.
constexpr std::chrono::milliseconds lock_patience{10};

/// Proper rotation, uniform over all of them: of the unit quaternion that two points on circles give
/// (Shoemake 1992, "Uniform Random Rotations").
glm::dmat3 random_rotation(RandomStream& random) {
  const double u = random.next_float();
  const double alpha = 2 * std::numbers::pi * static_cast<double>(random.next_float());
  const double beta = 2 * std::numbers::pi * static_cast<double>(random.next_float());
  const double s = std::sqrt(1 - u);
  const double t = std::sqrt(u);
  const double x = s * std::sin(alpha);
  const double y = s * std::cos(alpha);
  const double z = t * std::sin(beta);
  const double w = t * std::cos(beta);
  return {Vec3d(1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
          Vec3d(2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
          Vec3d(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))};
}

}  // namespace

Vec3d octahedral_direction(double a, double b) {
  const double d = 1 - std::abs(a) - std::abs(b);
  const double r = 1 - std::abs(d);
  const double phi = r > 0 ? std::numbers::pi / 4 * ((std::abs(b) - std::abs(a)) / r + 1) : 0;
  const double f = r * std::sqrt(2 - r * r);
  return {std::copysign(f * std::cos(phi), a), std::copysign(f * std::sin(phi), b),
          std::copysign(1 - r * r, d)};
}

std::shared_ptr<const DirectionTopology> DirectionTopology::of(int32_t n, const RayCounters& counters) {
  static std::timed_mutex mutex;
  static std::map<int32_t, std::shared_ptr<const DirectionTopology>> topologies;
  std::unique_lock lock(mutex, std::defer_lock);
  while (!lock.try_lock_for(lock_patience)) counters.poll();
  std::shared_ptr<const DirectionTopology>& topology = topologies[n];
  if (topology == nullptr) topology.reset(new DirectionTopology(n, counters));
  return topology;
}

int32_t DirectionTopology::side_for(int32_t directions) {
  int32_t n = least_side;
  while (n < greatest_side && n * n < directions) n += 2;
  return n;
}

DirectionTopology::DirectionTopology(int32_t n, const RayCounters& counters) : side_(n) {
  // Tiles of 4 x 4, then those of 2 columns or rows that are left over where 4 does not divide n.
  std::vector<uint32_t> number(static_cast<size_t>(n * n));
  const auto cell_index = [n](int32_t i, int32_t j) { return static_cast<size_t>(i * n + j); };
  for (int32_t tile_i = 0; tile_i < n; tile_i += 4) {
    counters.poll();
    for (int32_t tile_j = 0; tile_j < n; tile_j += 4) {
      for (int32_t i = tile_i; i < std::min(tile_i + 4, n); ++i) {
        for (int32_t j = tile_j; j < std::min(tile_j + 4, n); ++j) {
          number[cell_index(i, j)] = static_cast<uint32_t>(cells_.size());
          cells_.emplace_back(i, j);
        }
      }
    }
  }
  std::vector<Vec3d> middles;
  middles.reserve(size());
  for (const Vec2i& cell : cells_) {
    counters.poll_at(middles.size());
    middles.push_back(octahedral_direction((2.0 * cell.x + 1) / n - 1, (2.0 * cell.y + 1) / n - 1));
  }

  /// The other corners of the four quads around each vertex, with repetitions.
  struct Around {
    std::array<uint32_t, 12> vertices;
    size_t count = 0;
  };
  std::vector<Around> around(size());
  const auto add_triangle = [&](uint32_t a, uint32_t b, uint32_t c) {
    if (glm::dot(middles[a], glm::cross(middles[b], middles[c])) < 0) std::swap(b, c);
    triangles_.push_back({a, b, c});
  };
  const auto add_quad = [&](Vec2i p, Vec2i q, Vec2i r, Vec2i s) {
    const std::array<uint32_t, 4> corners{number[cell_index(p.x, p.y)], number[cell_index(q.x, q.y)],
                                          number[cell_index(r.x, r.y)], number[cell_index(s.x, s.y)]};
    add_triangle(corners[0], corners[1], corners[2]);
    add_triangle(corners[0], corners[2], corners[3]);
    for (const uint32_t corner : corners)
      for (const uint32_t other : corners)
        if (other != corner) around[corner].vertices.at(around[corner].count++) = other;
  };
  const int32_t m = n - 1;
  for (int32_t i = 0; i < m; ++i) {
    counters.poll();
    for (int32_t j = 0; j < m; ++j) add_quad({i, j}, {i + 1, j}, {i + 1, j + 1}, {i, j + 1});
  }
  // Each side of the square folds onto itself, and its four corners are one point.
  for (int32_t k = 0; k < n / 2 - 1; ++k) {
    for (const int32_t side : {0, m}) {
      add_quad({side, k}, {side, k + 1}, {side, m - 1 - k}, {side, m - k});
      add_quad({k, side}, {k + 1, side}, {m - 1 - k, side}, {m - k, side});
    }
  }
  add_quad({0, 0}, {m, 0}, {m, m}, {0, m});

  for (uint32_t i = 0; i < size(); ++i) {
    counters.poll_at(i);
    const auto begin = around[i].vertices.begin();
    const auto end = begin + static_cast<std::ptrdiff_t>(around[i].count);
    std::sort(begin, end);
    const std::ptrdiff_t count = std::unique(begin, end) - begin;
    std::array<uint32_t, 8> fixed;
    fixed.fill(i);
    std::copy_n(begin, std::min(count, std::ssize(fixed)), fixed.begin());
    neighbours_.push_back(fixed);
  }
  connect(counters);
}

void DirectionTopology::connect(const RayCounters& counters) {
  /// One side of an edge, filed under its lower vertex.
  struct Side {
    uint32_t upper = 0;
    uint32_t triangle = 0;
    uint32_t corner = 0;  ///< of the triangle, where the edge begins
  };
  const auto lower_upper = [this](uint32_t triangle, size_t corner) {
    const Triangle& t = triangles_[triangle];
    return std::minmax(t[corner], t[(corner + 1) % 3]);
  };
  std::vector<uint32_t> ends(size() + 1, 0);  // of each lower vertex's sides, once they are filed
  const auto count = static_cast<uint32_t>(triangles_.size());
  for (uint32_t t = 0; t < count; ++t) {
    counters.poll_at(t);
    for (size_t corner = 0; corner < 3; ++corner) ++ends[lower_upper(t, corner).first + 1];
  }
  std::partial_sum(ends.begin(), ends.end(), ends.begin());
  std::vector<Side> sides(ends.back());
  for (uint32_t t = 0; t < count; ++t) {
    counters.poll_at(t);
    for (uint32_t corner = 0; corner < 3; ++corner) {
      const auto [lower, upper] = lower_upper(t, corner);
      sides[ends[lower]++] = {upper, t, corner};
    }
  }
  triangle_edges_.resize(triangles_.size());
  edges_.reserve(sides.size() / 2);
  uint32_t begin = 0;
  for (uint32_t lower = 0; lower < size(); ++lower) {
    counters.poll_at(lower);
    const std::span<Side> own = std::span(sides).subspan(begin, ends[lower] - begin);
    begin = ends[lower];
    std::sort(own.begin(), own.end(), [](const Side& a, const Side& b) {
      return a.upper != b.upper ? a.upper < b.upper : a.triangle < b.triangle;
    });
    for (size_t i = 0; i + 1 < own.size(); i += 2) {
      const Side& left = own[i];
      const Side& right = own[i + 1];
      const Triangle& t = triangles_[left.triangle];
      triangle_edges_[left.triangle][left.corner] = static_cast<uint32_t>(edges_.size());
      triangle_edges_[right.triangle][right.corner] = static_cast<uint32_t>(edges_.size());
      edges_.push_back({t[left.corner], t[(left.corner + 1) % 3], left.triangle, right.triangle});
    }
  }
}

std::vector<Vec3f> stratified_directions(const DirectionTopology& topology, RandomStream& random,
                                         const RayCounters& counters) {
  const glm::dmat3 rotation = random_rotation(random);
  const double scale = 2.0 / topology.side();
  std::vector<Vec3f> directions;
  directions.reserve(topology.size());
  for (const Vec2i& cell : topology.cells()) {
    counters.poll_at(directions.size());
    const Vec2f u = random.next_vec2();
    const double a = (cell.x + 0.5 + jitter * (static_cast<double>(u.x) - 0.5)) * scale - 1;
    const double b = (cell.y + 0.5 + jitter * (static_cast<double>(u.y) - 0.5)) * scale - 1;
    directions.emplace_back(rotation * octahedral_direction(a, b));
  }
  return directions;
}

}  // namespace fogbank::derivatives
