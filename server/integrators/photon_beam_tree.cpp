#include "integrators/photon_beam_tree.h"

#include <algorithm>
#include <cmath>

namespace fogbank::integrators {

namespace {

/// Shortest pieces, in radii: boxes around shorter ones would be mostly margin.
constexpr float least_piece = 12;
/// Margin of boxes besides the radius, for rounding; a share of the coordinates' size.
constexpr float rounding = 1e-6f;
constexpr uint32_t most_leaves_of_part = 512;

}  // namespace

PhotonBeamTree::PhotonBeamTree(std::vector<transport::PhotonBeam> beams, float radius)
    : beams_(std::move(beams)), radius_(radius) {
  cut_into_pieces();
  const auto leaves = static_cast<uint32_t>((pieces_.size() + width - 1) / width);
  leaves_.resize(leaves);
  nodes_.resize(nodes_of(leaves));
  plan({0, leaves, 0});
}

void PhotonBeamTree::cut_into_pieces() {
  double total = 0;
  for (const transport::PhotonBeam& beam : beams_) total += static_cast<double>(beam.length);
  const double mean = total / static_cast<double>(beams_.size());
  const float length = std::fmax(least_piece * radius_, static_cast<float>(mean / (pieces_a_beam - 1)));
  for (uint32_t i = 0; i < beams_.size(); ++i) {
    const transport::PhotonBeam& beam = beams_[i];
    const float count = std::fmax(std::ceil(beam.length / length), 1.0f);
    for (float number = 0; number < count; ++number) {
      Piece piece;
      piece.begin = beam.length * (number / count);
      piece.end = beam.length * ((number + 1) / count);
      piece.center = beam.origin + beam.direction * (0.5f * (piece.begin + piece.end));
      piece.half = glm::abs(beam.direction) * (0.5f * (piece.end - piece.begin));
      piece.beam = i;
      pieces_.push_back(piece);
    }
  }
}

uint32_t PhotonBeamTree::unit_of(uint32_t leaves) {
  uint32_t unit = 1;
  while (unit * width < leaves) unit *= width;
  return unit;
}

uint32_t PhotonBeamTree::nodes_of(uint32_t leaves) {
  const uint32_t unit = unit_of(leaves);
  if (unit == 1) return 1;
  const uint32_t full = leaves / unit;
  const uint32_t rest = leaves % unit;
  return 1 + full * nodes_of(unit) + (rest > 0 ? nodes_of(rest) : 0);
}

void PhotonBeamTree::divide(uint32_t first, uint32_t count, uint32_t unit) {
  const uint32_t children = (count + unit - 1) / unit;
  if (children < 2) return;
  const uint32_t lower = (children + 1) / 2 * unit;
  const auto size = static_cast<uint32_t>(pieces_.size());
  const auto begin = pieces_.begin() + first * width;
  const auto end = pieces_.begin() + std::min((first + count) * width, size);
  Vec3f least(infinity);
  Vec3f most(-infinity);
  for (auto piece = begin; piece != end; ++piece) {
    least = glm::min(least, piece->center);
    most = glm::max(most, piece->center);
  }
  const Vec3f extent = most - least;
  int axis = extent.x >= extent.y ? 0 : 1;
  if (extent.z > extent[axis]) axis = 2;
  std::nth_element(begin, begin + lower * width, end,
                   [axis](const Piece& a, const Piece& b) { return a.center[axis] < b.center[axis]; });
  divide(first, lower, unit);
  divide(first + lower, count - lower, unit);
}

template <typename BuildChild>
void PhotonBeamTree::build_node(const Part& part, BuildChild&& build_child) {
  const uint32_t unit = unit_of(part.count);
  divide(part.first, part.count, unit);
  Node& node = nodes_[part.node];
  node.leaves = unit == 1;
  uint32_t next_node = part.node + 1;
  for (uint32_t i = 0; i < width; ++i) {
    Vec3f lower(infinity);
    Vec3f upper(-infinity);
    if (i * unit < part.count) {
      const uint32_t first = part.first + i * unit;
      const uint32_t count = std::min(unit, part.count - i * unit);
      const auto end = std::min<size_t>((size_t{first} + count) * width, pieces_.size());
      for (size_t piece = size_t{first} * width; piece < end; ++piece) {
        const Vec3f half = pieces_[piece].half + radius_;
        const Vec3f margin = rounding * (glm::abs(pieces_[piece].center) + half);
        lower = glm::min(lower, pieces_[piece].center - half - margin);
        upper = glm::max(upper, pieces_[piece].center + half + margin);
      }
      node.child[i] = node.leaves ? first : next_node;
      if (node.leaves) {
        fill_leaf(first);
      } else {
        build_child(Part{first, count, next_node});
        next_node += nodes_of(count);
      }
    }
    for (int axis = 0; axis < 3; ++axis) {
      node.lower[static_cast<size_t>(axis)][i] = lower[axis];
      node.upper[static_cast<size_t>(axis)][i] = upper[axis];
    }
  }
}

void PhotonBeamTree::plan(const Part& part) {
  if (part.count <= most_leaves_of_part) {
    parts_.push_back(part);
  } else {
    build_node(part, [this](const Part& child) { plan(child); });
  }
}

void PhotonBeamTree::build(const Part& part) {
  build_node(part, [this](const Part& child) { build(child); });
}

void PhotonBeamTree::build_part(uint32_t part) { build(parts_[part]); }

void PhotonBeamTree::fill_leaf(uint32_t leaf_index) {
  Leaf& leaf = leaves_[leaf_index];
  const size_t first = size_t{leaf_index} * width;
  const size_t count = std::min<size_t>(width, pieces_.size() - first);
  for (size_t lane = 0; lane < count; ++lane) {
    const Piece& piece = pieces_[first + lane];
    const transport::PhotonBeam& beam = beams_[piece.beam];
    for (int axis = 0; axis < 3; ++axis) {
      leaf.origin[static_cast<size_t>(axis)][lane] = beam.origin[axis];
      leaf.direction[static_cast<size_t>(axis)][lane] = beam.direction[axis];
    }
    leaf.begin[lane] = piece.begin;
    leaf.end[lane] = piece.end;
    leaf.beam[lane] = piece.beam;
  }
}

}  // namespace fogbank::integrators
