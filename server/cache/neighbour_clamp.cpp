#include "cache/neighbour_clamp.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace fogbank::cache {
namespace {

constexpr float infinite = std::numeric_limits<float>::infinity();

/// Hierarchy over the centres, shaped as EllipsoidTree, with the least radius below each box.
class RadiusTree {
 public:
  RadiusTree(std::span<const PositionPacket> positions, const std::vector<float>& radii)
      : positions_(positions) {
    leaves_.resize(positions.size(), broadcast(infinite));
    for (size_t i = 0; i < radii.size(); ++i) leaves_[i / packet_size][i % packet_size] = radii[i];
    levels_.emplace_back(parents(leaves_.size()));
    tbb::parallel_for(size_t{0}, leaves_.size(), [&](size_t packet) {
      Child child;
      for (uint32_t lane = 0; lane < packet_size && packet * packet_size + lane < radii.size(); ++lane) {
        const PositionPacket& centres = positions_[packet];
        const Vec3f centre(centres.at(0, lane), centres.at(1, lane), centres.at(2, lane));
        child.extend({centre, centre, leaves_[packet][lane]});
      }
      levels_[0][packet / packet_size].set(packet % packet_size, child);
    });
    while (levels_.back().size() > 1) {
      const std::vector<Node>& below = levels_.back();
      std::vector<Node> level(parents(below.size()));
      for (size_t node = 0; node < below.size(); ++node) {
        Child child;
        for (uint32_t lane = 0; lane < packet_size; ++lane) child.extend(below[node].get(lane));
        level[node / packet_size].set(node % packet_size, child);
      }
      levels_.push_back(std::move(level));
    }
  }

  float clamp(const Vec3f& point, float radius, size_t own_packet) const {
    const std::array<Float8, 3> at{broadcast(point.x), broadcast(point.y), broadcast(point.z)};
    // Neighbours along the curve first: with their bound most of the tree is passed over.
    float bound = radius;
    test_packet(own_packet, at, bound);
    descend(levels_.size() - 1, 0, at, bound);
    return bound;
  }

 private:
  struct Child {
    Vec3f low{infinite};
    Vec3f high{-infinite};
    float radius = infinite;

    void extend(const Child& other) {
      low = glm::min(low, other.low);
      high = glm::max(high, other.high);
      radius = std::min(radius, other.radius);
    }
  };

  struct Node {
    std::array<Float8, 3> low{broadcast(infinite), broadcast(infinite), broadcast(infinite)};
    std::array<Float8, 3> high{broadcast(-infinite), broadcast(-infinite), broadcast(-infinite)};
    Float8 radius = broadcast(infinite);

    void set(size_t lane, const Child& child) {
      for (int axis = 0; axis < 3; ++axis) {
        low[static_cast<size_t>(axis)][lane] = child.low[axis];
        high[static_cast<size_t>(axis)][lane] = child.high[axis];
      }
      radius[lane] = child.radius;
    }
    Child get(uint32_t lane) const {
      return {{low[0][lane], low[1][lane], low[2][lane]},
              {high[0][lane], high[1][lane], high[2][lane]},
              radius[lane]};
    }
  };

  static size_t parents(size_t nodes) { return (nodes + packet_size - 1) / packet_size; }

  void test_packet(size_t packet, const std::array<Float8, 3>& point, float& bound) const {
    Float8 squares{};
    for (size_t axis = 0; axis < 3; ++axis) {
      const Float8 offset = positions_[packet].axes[axis] - point[axis];
      squares += offset * offset;
    }
    const Float8 sums = leaves_[packet] + square_root(squares);
    for (uint32_t lane = 0; lane < packet_size; ++lane) bound = std::min(bound, sums[lane]);
  }

  void descend(size_t level, size_t number, const std::array<Float8, 3>& point, float& bound) const {
    const Node& node = levels_[level][number];
    Float8 squares{};
    for (size_t axis = 0; axis < 3; ++axis) {
      const Float8 below = node.low[axis] - point[axis];
      const Float8 above = point[axis] - node.high[axis];
      const Float8 outside = below > above ? below : above;
      const Float8 distance = outside > 0.0f ? outside : broadcast(0);
      squares += distance * distance;
    }
    // A little less than the least sum below, since sums are rounded: the minimum then hangs on the set
    // alone.
    const Float8 least = (node.radius + square_root(squares)) * (1 - 1e-6f);
    for (uint32_t lanes = mask_of(least < bound); lanes != 0; lanes &= lanes - 1) {
      const auto lane = static_cast<uint32_t>(std::countr_zero(lanes));
      if (!(least[lane] < bound)) continue;
      const size_t child = number * packet_size + lane;
      if (level > 0)
        descend(level - 1, child, point, bound);
      else
        test_packet(child, point, bound);
    }
  }

  std::span<const PositionPacket> positions_;
  std::vector<Float8> leaves_;
  std::vector<std::vector<Node>> levels_;
};

}  // namespace

std::vector<float> neighbour_clamp(std::span<const PositionPacket> positions,
                                   const std::vector<float>& radii) {
  if (radii.empty()) return {};
  const RadiusTree tree(positions, radii);
  std::vector<float> result(radii.size());
  tbb::parallel_for(size_t{0}, radii.size(), [&](size_t i) {
    const PositionPacket& centres = positions[i / packet_size];
    const uint32_t lane = i % packet_size;
    result[i] = tree.clamp({centres.at(0, lane), centres.at(1, lane), centres.at(2, lane)}, radii[i],
                           i / packet_size);
  });
  return result;
}

}  // namespace fogbank::cache
