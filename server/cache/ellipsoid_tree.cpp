#include "cache/ellipsoid_tree.h"

#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

namespace fogbank::cache {
namespace {

constexpr float infinite = std::numeric_limits<float>::infinity();

struct Box {
  Vec3f low{infinite};
  Vec3f high{-infinite};

  void extend(const Vec3f& other_low, const Vec3f& other_high) {
    low = glm::min(low, other_low);
    high = glm::max(high, other_high);
  }
};

/// Box that holds every point for which the test by the rounded shape may succeed. That test errs by some
/// roundings (6e-8) of coordinates of the size of the longest semi-axis, divided by the shortest one.
Box box_of(const Ellipsoid& ellipsoid, const Vec3f& centre) {
  if (ellipsoid.empty()) return {};
  const double aspect = static_cast<double>(ellipsoid.longest()) / static_cast<double>(ellipsoid.shortest());
  const Vec3d half = ellipsoid.half_extents() * (1 + 2e-6 * aspect);
  const Vec3d middle(centre);
  Box box;
  for (int axis = 0; axis < 3; ++axis) {
    box.low[axis] = std::nextafter(static_cast<float>(middle[axis] - half[axis]), -infinite);
    box.high[axis] = std::nextafter(static_cast<float>(middle[axis] + half[axis]), infinite);
  }
  return box;
}

}  // namespace

PointBundle::PointBundle(std::span<const Vec3f> points)
    : count(static_cast<uint32_t>(points.size())), low(points[0]), high(points[0]) {
  for (uint32_t lane = 0; lane < packet_size; ++lane) {
    const Vec3f& point = points[std::min<size_t>(lane, count - 1)];
    low = glm::min(low, point);
    high = glm::max(high, point);
    for (int axis = 0; axis < 3; ++axis) axes[static_cast<size_t>(axis)][lane] = point[axis];
  }
  centre = count == 1 ? low : 0.5f * low + 0.5f * high;
  // The half diagonal, and a little for the roundings of the centre.
  radius = count == 1 ? 0 : 0.5001f * glm::length(high - low);
}

EllipsoidTree::EllipsoidTree(std::span<const PositionPacket> positions, uint32_t count,
                             const std::function<Ellipsoid(uint32_t)>& ellipsoid) {
  if (count == 0) return;
  shapes_.resize(positions.size());
  for (size_t nodes = (positions.size() + packet_size - 1) / packet_size;;
       nodes = (nodes + packet_size - 1) / packet_size) {
    levels_.emplace_back(nodes);
    if (nodes == 1) break;
  }
  const auto set_child = [](BoxPacket& node, uint32_t lane, const Box& box) {
    for (int axis = 0; axis < 3; ++axis) {
      node.low[static_cast<size_t>(axis)][lane] = box.low[axis];
      node.high[static_cast<size_t>(axis)][lane] = box.high[axis];
    }
  };
  // Minima and maxima are exact, so boxes are the same whichever thread makes them.
  tbb::parallel_for(size_t{0}, levels_[0].size(), [&](size_t node) {
    for (uint32_t lane = 0; lane < packet_size; ++lane) {
      const size_t packet = node * packet_size + lane;
      Box box;
      if (packet < shapes_.size()) {
        for (uint32_t place = 0; place < packet_size; ++place) {
          const auto number = static_cast<uint32_t>(packet * packet_size + place);
          Ellipsoid shape;
          if (number < count) shape = ellipsoid(number);
          const Symmetric3d root = shape.inverse_root();
          for (size_t entry = 0; entry < root.entries.size(); ++entry)
            shapes_[packet].entries[entry][place] = static_cast<float>(root.entries[entry]);
          const PositionPacket& centres = positions[packet];
          const Box one = box_of(shape, {centres.at(0, place), centres.at(1, place), centres.at(2, place)});
          box.extend(one.low, one.high);
        }
      }
      set_child(levels_[0][node], lane, box);
    }
  });
  for (size_t level = 1; level < levels_.size(); ++level) {
    tbb::parallel_for(size_t{0}, levels_[level].size(), [&](size_t node) {
      for (uint32_t lane = 0; lane < packet_size; ++lane) {
        const size_t child = node * packet_size + lane;
        Box box;
        if (child < levels_[level - 1].size()) {
          const BoxPacket& boxes = levels_[level - 1][child];
          for (uint32_t i = 0; i < packet_size; ++i)
            box.extend({boxes.low[0][i], boxes.low[1][i], boxes.low[2][i]},
                       {boxes.high[0][i], boxes.high[1][i], boxes.high[2][i]});
        }
        set_child(levels_[level][node], lane, box);
      }
    });
  }
}

size_t EllipsoidTree::memory() const {
  size_t bytes = shapes_.capacity() * sizeof(ShapePacket);
  for (const auto& level : levels_) bytes += level.capacity() * sizeof(BoxPacket);
  return bytes;
}

}  // namespace fogbank::cache
