// Search for all ellipsoids that hold a point.
#pragma once

#include <algorithm>
#include <functional>
#include <span>
#include <vector>

#include "cache/metric.h"
#include "cache/packet.h"

namespace fogbank::cache {

/// One to eight points close together, searched for and evaluated side by side: neighbouring pixels' at the
/// same distance, say. The farther apart they are the more ellipsoids hold only some of them.
struct PointBundle {
  std::array<Float8, 3> axes;  ///< lanes beyond the last point repeat it
  uint32_t count = 0;
  Vec3f low;
  Vec3f high;
  Vec3f centre;
  float radius;  ///< of a ball around the centre that holds them all; 0 for one point

  explicit PointBundle(std::span<const Vec3f> points);
};

/// Packed R-tree (Kamel and Faloutsos 1993, "On Packing R-trees"): eight ellipsoids that follow each other
/// along a Hilbert curve are a packet, eight packets' boxes a node, eight nodes' boxes a node above. It has
/// no pointers and no free places (27.5 bytes an ellipsoid), its shape hangs on the positions only, and it is
/// built in one sweep. A search goes level by level without branches that depend on the outcome of a test.
class EllipsoidTree {
 public:
  EllipsoidTree() = default;
  /// `count` ellipsoids around `positions`; `ellipsoid(i)` is called once for each, by several threads.
  EllipsoidTree(std::span<const PositionPacket> positions, uint32_t count,
                const std::function<Ellipsoid(uint32_t)>& ellipsoid);

  /// Calls visitor(const uint32_t* numbers, uint32_t count), in chunks, with all ellipsoids that hold one of
  /// the points, and perhaps some that are close, ascending. `positions` as given to the constructor.
  template <typename Visitor>
  void search(std::span<const PositionPacket> positions, const PointBundle& points, Visitor&& visitor) const {
    const uint32_t root = 0;
    if (!levels_.empty()) descend(levels_.size() - 1, &root, 1, positions.data(), points, visitor);
  }
  /// Whether the box around the points touches no more than `limit` packets: beyond
  /// some twice what one point touches, points are cheaper apart.
  bool touches_at_most(const PointBundle& points, uint32_t limit) const {
    return levels_.empty() || count(levels_.size() - 1, 0, points, limit);
  }
  /// |W d|^2 for ellipsoid `number`, d = (x, y, z) the offsets of eight points from its centre.
  Float8 normalised_square(uint32_t number, Float8 x, Float8 y, Float8 z) const {
    const ShapePacket& packet = shapes_[number / packet_size];
    std::array<Float8, 6> shape;
    for (size_t entry = 0; entry < shape.size(); ++entry)
      shape[entry] = broadcast(packet.entries[entry][number % packet_size]);
    return cache::normalised_square(shape, x, y, z);
  }

  /// W of ellipsoid `number`; NaN where it holds nothing.
  Symmetric3d inverse_root(uint32_t number) const {
    Symmetric3d shape;
    for (size_t entry = 0; entry < shape.entries.size(); ++entry)
      shape.entries[entry] =
          static_cast<double>(shapes_[number / packet_size].entries[entry][number % packet_size]);
    return shape;
  }
  /// Trace of W: sum of the reciprocals of the semi-axes; NaN where it holds nothing.
  float inverse_trace(uint32_t number) const {
    const std::array<Float8, 6>& w = shapes_[number / packet_size].entries;
    const uint32_t lane = number % packet_size;
    return w[0][lane] + w[3][lane] + w[5][lane];
  }

  size_t memory() const;

 private:
  /// Boxes of eight children; empty ones hold nothing.
  struct alignas(64) BoxPacket {
    std::array<Float8, 3> low;
    std::array<Float8, 3> high;

    uint32_t touched_by(const PointBundle& points) const {
      return mask_of((points.high.x >= low[0]) & (points.low.x <= high[0]) & (points.high.y >= low[1]) &
                     (points.low.y <= high[1]) & (points.high.z >= low[2]) & (points.low.z <= high[2]));
    }
  };

  /// Takes the packets below a node from `left`; false as soon as they are more.
  bool count(size_t level, uint32_t node, const PointBundle& points, uint32_t& left) const {
    uint32_t lanes = levels_[level][node].touched_by(points);
    if (level == 0) {
      const auto found = static_cast<uint32_t>(std::popcount(lanes));
      if (found > left) return false;
      left -= found;
      return true;
    }
    for (; lanes != 0; lanes &= lanes - 1)
      if (!count(level - 1, node * packet_size + static_cast<uint32_t>(std::countr_zero(lanes)), points,
                 left))
        return false;
    return true;
  }

  static constexpr uint32_t at_once = 32;
  using Found = std::array<uint32_t, at_once * packet_size + packet_size>;

  template <typename Visitor>
  void descend(size_t level, const uint32_t* nodes, uint32_t count, const PositionPacket* positions,
               const PointBundle& points, Visitor& visitor) const {
    Found children;
    const BoxPacket* boxes = levels_[level].data();
    for (uint32_t begin = 0; begin < count; begin += at_once) {
      const uint32_t end = std::min(count, begin + at_once);
      uint32_t found = 0;
      for (uint32_t i = begin; i < end; ++i)
        found +=
            append_set_bits(boxes[nodes[i]].touched_by(points), nodes[i] * packet_size, &children[found]);
      if (level > 0)
        descend(level - 1, children.data(), found, positions, points, visitor);
      else
        test(children.data(), found, positions, points, visitor);
    }
  }

  /// An ellipsoid holds no point of the ball if its centre is farther than 1 + radius * (norm of W) away in
  /// its own measure. The norm is at most the greatest sum of a row; 1 % is for roundings, which grow with
  /// the ratio of semi-axes to 0.4 % at most: what is found may not hang on the company that a point is in.
  template <typename Visitor>
  void test(const uint32_t* packets, uint32_t count, const PositionPacket* positions,
            const PointBundle& points, Visitor& visitor) const {
    Found numbers;
    for (uint32_t begin = 0; begin < count; begin += at_once) {
      const uint32_t end = std::min(count, begin + at_once);
      uint32_t found = 0;
      for (uint32_t i = begin; i < end; ++i) {
        const PositionPacket& centres = positions[packets[i]];
        const std::array<Float8, 6>& w = shapes_[packets[i]].entries;
        const Float8 square =
            cache::normalised_square(w, points.centre.x - centres.axes[0], points.centre.y - centres.axes[1],
                                     points.centre.z - centres.axes[2]);
        const Float8 xy = absolute(w[1]);
        const Float8 xz = absolute(w[2]);
        const Float8 yz = absolute(w[4]);
        const Float8 norm = greater(w[0] + xy + xz, greater(xy + w[3] + yz, xz + yz + w[5]));
        const Float8 reach = 1.01f + points.radius * norm;
        found += append_set_bits(mask_of(square < reach * reach), packets[i] * packet_size, &numbers[found]);
      }
      if (found > 0) visitor(numbers.data(), found);
    }
  }

  std::vector<ShapePacket> shapes_;
  std::vector<std::vector<BoxPacket>>
      levels_;  ///< [0]: boxes of packets; the last one has one element, the root
};

}  // namespace fogbank::cache
