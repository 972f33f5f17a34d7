// Photon beams, found along camera rays: a tree of boxes around short pieces of the beams, eight children a
// node, that is built in parts by any threads with the same result.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <vector>

#include "derivatives/simd.h"
#include "transport/photon_tracer.h"

namespace fogbank::integrators {

/// A camera ray and a beam that pass each other within the radius.
struct BeamCrossing {
  uint32_t beam = 0;
  float camera_distance = 0;  ///< along the camera ray
  float beam_distance = 0;    ///< along the beam
  float gap = 0;              ///< between the two lines, < radius
  float sine = 1;             ///< of the angle between them, > 0
};

/// Memory: 60 bytes a beam and 90 a piece; at most `pieces_a_beam` pieces a beam on average.
class PhotonBeamTree {
 public:
  static constexpr uint32_t pieces_a_beam = 8;

  /// Prepares to build; `radius` > 0, scene units. Beams are finite and at least one.
  PhotonBeamTree(std::vector<transport::PhotonBeam> beams, float radius);
  /// Independent parts to be built, each once, by any thread, before anything is looked up.
  uint32_t part_count() const { return static_cast<uint32_t>(parts_.size()); }
  void build_part(uint32_t part);

  float radius() const { return radius_; }
  const transport::PhotonBeam& beam(uint32_t index) const { return beams_[index]; }

  /// Calls visit(crossing) for every beam within `radius` of the ray's stretch [0, max_distance), in an order
  /// that depends on nothing but beams and ray.
  template <typename Visit>
  void find(const Ray& ray, Visit&& visit) const;

 private:
  static constexpr uint32_t width = 8;
  /// Lines that are closer to parallel don't cross: they would count by 1 / sine.
  static constexpr float least_sine_squared = 1e-8f;
  using Lanes = derivatives::Simd<float>;

  struct Piece {
    Vec3f center{0};
    Vec3f half{0};  ///< of its box, without the radius
    float begin = 0;
    float end = 0;
    uint32_t beam = 0;
  };
  /// Boxes of eight children. A child is a node, or eight pieces where `leaves`; missing children's boxes are
  /// inside out.
  struct alignas(32) Node {
    std::array<Lanes, 3> lower;
    std::array<Lanes, 3> upper;
    std::array<uint32_t, width> child{};
    bool leaves = false;
  };
  /// Eight pieces; those that are missing have an empty stretch.
  struct alignas(32) Leaf {
    std::array<Lanes, 3> origin{};
    std::array<Lanes, 3> direction{};
    Lanes begin{};
    Lanes end{};
    std::array<uint32_t, width> beam{};
  };
  /// A subtree: leaves [first, first + count), its nodes from `node` on, the root first. A node's children
  /// have `unit` leaves each, but for the last one: a power of eight, so that all nodes but one a level are
  /// full.
  struct Part {
    uint32_t first = 0;
    uint32_t count = 0;
    uint32_t node = 0;
  };

  static uint32_t unit_of(uint32_t leaves);
  static uint32_t nodes_of(uint32_t leaves);
  /// Bit i is set where lane i of a comparison's result is.
  template <typename Mask>
  static uint32_t bits_of(const Mask& mask);

  void cut_into_pieces();
  /// Calls build_child(i, child) for the children of a node, after sorting its pieces among them and setting
  /// the node's boxes.
  template <typename BuildChild>
  void build_node(const Part& part, BuildChild&& build_child);
  void divide(uint32_t first, uint32_t count, uint32_t unit);
  void plan(const Part& part);
  void build(const Part& part);
  void fill_leaf(uint32_t leaf);

  std::vector<transport::PhotonBeam> beams_;
  float radius_;
  std::vector<Piece> pieces_;
  std::vector<Node> nodes_;
  std::vector<Leaf> leaves_;
  std::vector<Part> parts_;
};

template <typename Mask>
uint32_t PhotonBeamTree::bits_of(const Mask& mask) {
#if defined(__AVX2__)
  return static_cast<uint32_t>(_mm256_movemask_ps(std::bit_cast<__m256>(mask)));
#else
  uint32_t bits = 0;
  for (uint32_t i = 0; i < width; ++i) bits |= mask[i] != 0 ? 1u << i : 0u;
  return bits;
#endif
}

template <typename Visit>
void PhotonBeamTree::find(const Ray& ray, Visit&& visit) const {
  const Lanes zero{};
  const Vec3f& o = ray.origin;
  const Vec3f& d = ray.direction;
  // Coordinates of zero would make 0 * infinity: a huge number does as well.
  const auto inverse = [](float x) { return std::fabs(x) > 1e-18f ? 1 / x : std::copysign(1e18f, x); };
  const Vec3f inverse_d(inverse(d.x), inverse(d.y), inverse(d.z));
  std::array<uint32_t, 96> stack;
  size_t stacked = 0;
  stack[stacked++] = 0;
  while (stacked > 0) {
    const Node& node = nodes_[stack[--stacked]];
    Lanes near = zero;
    Lanes far = zero + ray.max_distance;
    for (int axis = 0; axis < 3; ++axis) {
      const Lanes a = (node.lower[axis] - o[axis]) * inverse_d[axis];
      const Lanes b = (node.upper[axis] - o[axis]) * inverse_d[axis];
      const Lanes first = inverse_d[axis] > 0 ? a : b;
      const Lanes last = inverse_d[axis] > 0 ? b : a;
      near = first > near ? first : near;
      far = last < far ? last : far;
    }
    for (uint32_t met = bits_of(near <= far); met != 0; met &= met - 1) {
      const auto i = static_cast<size_t>(std::countr_zero(met));
      if (!node.leaves) {
        stack[stacked++] = node.child[i];
        continue;
      }
      const Leaf& leaf = leaves_[node.child[i]];
      // Nearest points of two lines: o + t d and p + s q, with w = o - p and n = d x q.
      const Lanes wx = o.x - leaf.origin[0];
      const Lanes wy = o.y - leaf.origin[1];
      const Lanes wz = o.z - leaf.origin[2];
      const Lanes& qx = leaf.direction[0];
      const Lanes& qy = leaf.direction[1];
      const Lanes& qz = leaf.direction[2];
      const Lanes nx = d.y * qz - d.z * qy;
      const Lanes ny = d.z * qx - d.x * qz;
      const Lanes nz = d.x * qy - d.y * qx;
      const Lanes sine_squared = nx * nx + ny * ny + nz * nz;
      const Lanes volume = wx * nx + wy * ny + wz * nz;
      const Lanes gap_squared = volume * volume / sine_squared;
      const Lanes cosine = d.x * qx + d.y * qy + d.z * qz;
      const Lanes along_d = wx * d.x + wy * d.y + wz * d.z;
      const Lanes along_q = wx * qx + wy * qy + wz * qz;
      const Lanes t = (cosine * along_q - along_d) / sine_squared;
      const Lanes s = (along_q - cosine * along_d) / sine_squared;
      const auto crossing = (gap_squared < radius_ * radius_) & (sine_squared > least_sine_squared) &
                           (t >= zero) & (t < ray.max_distance) & (s >= leaf.begin) & (s < leaf.end);
      for (uint32_t crosses = bits_of(crossing); crosses != 0; crosses &= crosses - 1) {
        const auto lane = static_cast<size_t>(std::countr_zero(crosses));
        visit(BeamCrossing{leaf.beam[lane], t[lane], s[lane], std::sqrt(gap_squared[lane]),
                           std::sqrt(sine_squared[lane])});
      }
    }
  }
}

}  // namespace fogbank::integrators
