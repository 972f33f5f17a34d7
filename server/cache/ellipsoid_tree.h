// Search for all ellipsoids that hold a point.
#pragma once

#include <algorithm>
#include <functional>
#include <span>
#include <utility>
#include <vector>

#include "cache/metric.h"
#include "cache/packet.h"

namespace fogbank::cache {

/// Ellipsoids that hold a point, in their order; arrays are padded to whole packets.
struct Hits {
  static constexpr uint32_t packets_at_once = 32;
  static constexpr uint32_t capacity = packets_at_once * packet_size;

  uint32_t count = 0;
  std::array<uint32_t, capacity + packet_size> places;
  /// Offsets of the point from the centres.
  std::array<float, capacity + packet_size> x, y, z;
  std::array<float, capacity + packet_size> squared_distance;  ///< normalised, |W d|^2 < 1
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

  /// Calls visitor(const Hits&) for all ellipsoids that hold `point`, ascending, in chunks. `positions` as
  /// given to the constructor.
  template <typename Visitor>
  void search(std::span<const PositionPacket> positions, const Vec3f& point, Visitor&& visitor) const {
    const std::array<Float8, 3> at{broadcast(point.x), broadcast(point.y), broadcast(point.z)};
    const uint32_t root = 0;
    if (!levels_.empty()) descend(levels_.size() - 1, &root, 1, positions.data(), at, visitor);
  }

  size_t memory() const;

 private:
  /// Boxes of eight children; empty ones hold nothing.
  struct BoxPacket {
    std::array<Float8, 3> low;
    std::array<Float8, 3> high;

    uint32_t holding(const std::array<Float8, 3>& point) const {
      return mask_of((point[0] >= low[0]) & (point[0] <= high[0]) & (point[1] >= low[1]) &
                     (point[1] <= high[1]) & (point[2] >= low[2]) & (point[2] <= high[2]));
    }
  };

  template <typename Visitor>
  void descend(size_t level, const uint32_t* nodes, uint32_t count, const PositionPacket* positions,
               const std::array<Float8, 3>& point, Visitor& visitor) const {
    constexpr uint32_t nodes_at_once = 32;
    std::array<uint32_t, nodes_at_once * packet_size + packet_size> children;
    for (uint32_t begin = 0; begin < count; begin += nodes_at_once) {
      const uint32_t end = std::min(count, begin + nodes_at_once);
      uint32_t found = 0;
      for (uint32_t i = begin; i < end; ++i)
        found += append_set_bits(levels_[level][nodes[i]].holding(point), nodes[i] * packet_size,
                                 children.data() + found);
      if (level > 0)
        descend(level - 1, children.data(), found, positions, point, visitor);
      else
        test(children.data(), found, positions, point, visitor);
    }
  }

  template <typename Visitor>
  void test(const uint32_t* packets, uint32_t count, const PositionPacket* positions,
            const std::array<Float8, 3>& point, Visitor& visitor) const {
    Hits hits;
    for (uint32_t begin = 0; begin < count; begin += Hits::packets_at_once) {
      const uint32_t end = std::min(count, begin + Hits::packets_at_once);
      uint32_t found = 0;
      for (uint32_t i = begin; i < end; ++i) {
        const PositionPacket& centres = positions[packets[i]];
        const Float8 x = point[0] - centres.axes[0];
        const Float8 y = point[1] - centres.axes[1];
        const Float8 z = point[2] - centres.axes[2];
        const Float8 squared_distance = shapes_[packets[i]].squared_distance(x, y, z);
        const uint32_t mask = mask_of(squared_distance < 1.0f);
        append_selected(mask, x, hits.x.data() + found);
        append_selected(mask, y, hits.y.data() + found);
        append_selected(mask, z, hits.z.data() + found);
        append_selected(mask, squared_distance, hits.squared_distance.data() + found);
        found += append_set_bits(mask, packets[i] * packet_size, hits.places.data() + found);
      }
      if (found == 0) continue;
      hits.count = found;
      for (auto* padded : {&hits.x, &hits.y, &hits.z, &hits.squared_distance})
        std::fill_n(padded->data() + found, packet_size, 0.0f);
      visitor(std::as_const(hits));
    }
  }

  std::vector<ShapePacket> shapes_;
  std::vector<std::vector<BoxPacket>>
      levels_;  ///< [0]: boxes of packets; the last one has one element, the root
};

}  // namespace fogbank::cache
