// Photon beams, found along camera rays: a grid of cells a few radii wide, each with the beams that come
// within the radius of it. As the radius is the same everywhere, so is the share of a cell's beams that a ray
// crosses. Built in parts by any threads with the same result.
#pragma once

#include <algorithm>
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

/// Memory: 92 bytes a beam, 4 bytes for each of about `entries_a_beam` cells that it lies in at most, and
/// 4 bytes for each cell, of which there are at most `cells_a_beam` a beam.
class PhotonBeamGrid {
 public:
  static constexpr uint32_t entries_a_beam = 256;
  static constexpr uint32_t cells_a_beam = 32;

  /// Prepares to build; `radius` > 0, scene units. Beams are finite and at least one.
  PhotonBeamGrid(std::vector<transport::PhotonBeam> beams, float radius);
  /// Independent parts to be built, each once, by any thread, before anything is looked up.
  uint32_t part_count() const { return static_cast<uint32_t>(slabs_.size()); }
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

  /// Cells of a few layers across the grid's longest axis; their entries cell by cell.
  struct Slab {
    std::vector<uint32_t> first;  ///< of each cell; one more than cells
    std::vector<uint32_t> beams;
  };
  /// Beams that wait to be looked at together, each with the stretch of the ray within its cell.
  struct Batch {
    std::array<uint32_t, width> beam{};
    Lanes enter{};
    Lanes exit{};
    uint32_t count = 0;
  };

  /// Bit i is set where lane i of a comparison's result is.
  template <typename Mask>
  static uint32_t bits_of(const Mask& mask);
  template <typename Visit>
  void look_at(const Batch& batch, const Ray& ray, Visit&& visit) const;
  /// Calls visit(cell) for the cells of layers [first, end) that the beam may come within the radius of.
  template <typename Visit>
  void cells_of(const transport::PhotonBeam& line, int32_t first, int32_t end, Visit&& visit) const;
  uint32_t cell_in_slab(const glm::ivec3& cell) const;

  std::vector<transport::PhotonBeam> beams_;
  std::vector<Lanes> lines_;  ///< of each beam: origin, direction, length, 0
  float radius_;
  float reach_ = 0;  ///< the radius with a margin for rounding
  float cell_ = 1;   ///< side of a cell
  float inverse_cell_ = 1;
  Vec3f lower_{0};
  glm::ivec3 size_{1};  ///< cells
  int axis_ = 0;        ///< the longest
  int32_t layers_of_slab_ = 1;
  std::vector<Slab> slabs_;
};

template <typename Mask>
uint32_t PhotonBeamGrid::bits_of(const Mask& mask) {
#if defined(__AVX2__)
  return static_cast<uint32_t>(_mm256_movemask_ps(std::bit_cast<__m256>(mask)));
#else
  uint32_t bits = 0;
  for (uint32_t i = 0; i < width; ++i) bits |= mask[i] != 0 ? 1u << i : 0u;
  return bits;
#endif
}

template <typename Visit>
void PhotonBeamGrid::look_at(const Batch& batch, const Ray& ray, Visit&& visit) const {
  const auto [px, py, pz, qx, qy, qz, length, unused] = derivatives::transpose(std::array<Lanes, width>{
      lines_[batch.beam[0]], lines_[batch.beam[1]], lines_[batch.beam[2]], lines_[batch.beam[3]],
      lines_[batch.beam[4]], lines_[batch.beam[5]], lines_[batch.beam[6]], lines_[batch.beam[7]]});
  // Nearest points of two lines: o + t d and p + s q, with w = o - p and n = d x q.
  const Vec3f& d = ray.direction;
  const Lanes wx = ray.origin.x - px;
  const Lanes wy = ray.origin.y - py;
  const Lanes wz = ray.origin.z - pz;
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
                        (t >= batch.enter) & (t < batch.exit) & (s >= Lanes{}) & (s < length);
  for (uint32_t bits = bits_of(crossing); bits != 0; bits &= bits - 1) {
    const auto lane = static_cast<size_t>(std::countr_zero(bits));
    visit(BeamCrossing{batch.beam[lane], t[lane], s[lane], std::sqrt(gap_squared[lane]),
                       std::sqrt(sine_squared[lane])});
  }
}

template <typename Visit>
void PhotonBeamGrid::find(const Ray& ray, Visit&& visit) const {
  // From cell to cell (Amanatides and Woo 1987, "A Fast Voxel Traversal Algorithm for Ray Tracing").
  float enter = 0;
  float end = ray.max_distance;
  Vec3f next(infinity);  // distance to the next wall across each axis
  Vec3f step(infinity);  // between two of them
  glm::ivec3 way(0);
  for (int axis = 0; axis < 3; ++axis) {
    const float direction = ray.direction[axis];
    const float upper = lower_[axis] + static_cast<float>(size_[axis]) * cell_;
    if (direction == 0) {
      if (!(ray.origin[axis] >= lower_[axis] && ray.origin[axis] < upper)) return;
      continue;
    }
    const float a = (lower_[axis] - ray.origin[axis]) / direction;
    const float b = (upper - ray.origin[axis]) / direction;
    enter = std::fmax(enter, std::fmin(a, b));
    end = std::fmin(end, std::fmax(a, b));
    step[axis] = cell_ / std::fabs(direction);
    way[axis] = direction > 0 ? 1 : -1;
  }
  if (!(enter < end)) return;
  glm::ivec3 cell(0);
  for (int axis = 0; axis < 3; ++axis) {
    const float place = (ray.origin[axis] + enter * ray.direction[axis] - lower_[axis]) * inverse_cell_;
    cell[axis] = std::clamp(static_cast<int32_t>(place), 0, size_[axis] - 1);
    if (way[axis] == 0) continue;
    const float wall = lower_[axis] + static_cast<float>(cell[axis] + (way[axis] > 0 ? 1 : 0)) * cell_;
    next[axis] = (wall - ray.origin[axis]) / ray.direction[axis];
  }
  Batch batch;
  while (enter < end) {
    int axis = next.x <= next.y ? 0 : 1;
    if (next.z < next[axis]) axis = 2;
    const float exit = std::fmin(next[axis], end);
    const Slab& slab = slabs_[static_cast<size_t>(cell[axis_] / layers_of_slab_)];
    const uint32_t in_slab = cell_in_slab(cell);
    for (uint32_t i = slab.first[in_slab]; i < slab.first[in_slab + 1]; ++i) {
      batch.beam[batch.count] = slab.beams[i];
      batch.enter[batch.count] = enter;
      batch.exit[batch.count] = exit;
      if (++batch.count < width) continue;
      look_at(batch, ray, visit);
      batch.count = 0;
    }
    enter = std::fmax(enter, exit);
    next[axis] += step[axis];
    cell[axis] += way[axis];
    if (cell[axis] < 0 || cell[axis] >= size_[axis]) break;
  }
  if (batch.count == 0) return;
  for (uint32_t lane = batch.count; lane < width; ++lane) {
    batch.beam[lane] = batch.beam[0];
    batch.exit[lane] = batch.enter[lane] = 0;
  }
  look_at(batch, ray, visit);
}

}  // namespace fogbank::integrators
