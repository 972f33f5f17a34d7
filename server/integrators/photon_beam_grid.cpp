#include "integrators/photon_beam_grid.h"

#include <algorithm>
#include <cmath>

namespace fogbank::integrators {

namespace {

/// Side of a cell in radii: smaller ones hold fewer beams that the ray misses, but a beam lies in more.
constexpr float radii_a_cell = 4;

/// Cells that a beam lies in where it crosses one layer, about.
constexpr float cells_a_layer = 3;
/// Added to the radius where beams are put into cells, as a share of a cell: more than rounding moves a
/// camera ray's points over the walls.
constexpr float margin_of_cell = 0.01f;
/// Few beams may have that many cells, too.
constexpr double least_most_cells = 4096;
constexpr int32_t slabs_at_most = 32;

}  // namespace

PhotonBeamGrid::PhotonBeamGrid(std::vector<transport::PhotonBeam> beams, float radius)
    : beams_(std::move(beams)), radius_(radius) {
  Vec3f lower(infinity);
  Vec3f upper(-infinity);
  double total = 0;
  lines_.reserve(beams_.size());
  for (const transport::PhotonBeam& beam : beams_) {
    lines_.push_back(Lanes{beam.origin.x, beam.origin.y, beam.origin.z, beam.direction.x, beam.direction.y,
                           beam.direction.z, beam.length, 0});
    total += static_cast<double>(beam.length);
    const Vec3f end = beam.origin + beam.direction * beam.length;
    lower = glm::min(lower, glm::min(beam.origin, end));
    upper = glm::max(upper, glm::max(beam.origin, end));
  }
  const double mean_length = total / static_cast<double>(beams_.size());
  // As small as the radius, the memory and the coordinates' rounding allow.
  const Vec3f size = upper - lower;
  const float largest = std::fmax(max_component(glm::abs(lower)), max_component(glm::abs(upper)));
  cell_ = std::fmax(radii_a_cell * radius_, 1e-4f * std::fmax(largest, max_component(size)));
  cell_ = std::fmax(cell_, static_cast<float>(mean_length) * cells_a_layer / entries_a_beam);
  const auto count_of = [&](float cell) {
    const Vec3f cells = glm::ceil((size + 2 * (radius_ + margin_of_cell * cell)) / cell) + 1.0f;
    return static_cast<double>(cells.x) * static_cast<double>(cells.y) * static_cast<double>(cells.z);
  };
  const double most_cells =
      std::max(static_cast<double>(cells_a_beam) * static_cast<double>(beams_.size()), least_most_cells);
  while (count_of(cell_) > most_cells) cell_ *= 1.1f;
  inverse_cell_ = 1 / cell_;
  reach_ = radius_ + margin_of_cell * cell_;
  lower_ = lower - reach_;
  size_ = glm::ivec3(glm::floor((size + 2 * reach_) * inverse_cell_)) + 1;
  axis_ = size.x >= size.y ? 0 : 1;
  if (size.z > size[axis_]) axis_ = 2;
  layers_of_slab_ = (size_[axis_] + slabs_at_most - 1) / slabs_at_most;
  slabs_.resize(static_cast<size_t>((size_[axis_] + layers_of_slab_ - 1) / layers_of_slab_));
}

uint32_t PhotonBeamGrid::cell_in_slab(const glm::ivec3& cell) const {
  const int b = (axis_ + 1) % 3;
  const int c = (axis_ + 2) % 3;
  return static_cast<uint32_t>((cell[axis_] % layers_of_slab_ * size_[b] + cell[b]) * size_[c] + cell[c]);
}

template <typename Visit>
void PhotonBeamGrid::cells_of(const transport::PhotonBeam& line, int32_t first, int32_t end,
                              Visit&& visit) const {
  // The stretch of the beam that can reach the slab.
  const Vec3f origin = line.origin - lower_;
  const auto stretch = [&](int axis, float from, float to, float& begin, float& last) {
    const float direction = line.direction[axis];
    if (direction == 0) {
      if (origin[axis] < from || origin[axis] > to) last = -1;
      return;
    }
    const float a = (from - origin[axis]) / direction;
    const float b = (to - origin[axis]) / direction;
    begin = std::fmax(begin, std::fmin(a, b));
    last = std::fmin(last, std::fmax(a, b));
  };
  float slab_begin = 0;
  float slab_end = line.length;
  stretch(axis_, static_cast<float>(first) * cell_ - reach_, static_cast<float>(end) * cell_ + reach_,
          slab_begin, slab_end);
  if (slab_begin > slab_end) return;
  glm::ivec3 lower(0);
  glm::ivec3 upper = size_ - 1;
  lower[axis_] = first;
  upper[axis_] = end - 1;
  const auto bound = [&](float a, float b, int32_t& from, int32_t& to) {
    const float least = std::fmin(a, b) - reach_;
    const float most = std::fmax(a, b) + reach_;
    from = std::max(from, static_cast<int32_t>(std::floor(least * inverse_cell_)));
    to = std::min(to, static_cast<int32_t>(std::floor(most * inverse_cell_)));
  };
  // Layer by layer across the axis that the beam mostly runs along.
  const Vec3f size = glm::abs(line.direction);
  int main = size.x >= size.y ? 0 : 1;
  if (size.z > size[main]) main = 2;
  const int b = (main + 1) % 3;
  const int c = (main + 2) % 3;
  bound(origin[main] + slab_begin * line.direction[main], origin[main] + slab_end * line.direction[main],
        lower[main], upper[main]);
  // A plane along the beam and the main axis cuts off the corners of a layer's rectangle of cells.
  const Vec2f normal(line.direction[c], -line.direction[b]);
  const float across = glm::length(normal);
  const float half = reach_ * across + 0.5f * cell_ * (std::fabs(normal.x) + std::fabs(normal.y));
  const float offset = normal.x * origin[b] + normal.y * origin[c];
  glm::ivec3 cell;
  for (cell[main] = lower[main]; cell[main] <= upper[main]; ++cell[main]) {
    float begin = slab_begin;
    float last = slab_end;
    const float wall = static_cast<float>(cell[main]) * cell_;
    stretch(main, wall - reach_, wall + cell_ + reach_, begin, last);
    if (begin > last) continue;
    int32_t b_first = lower[b];
    int32_t b_last = upper[b];
    int32_t c_first = lower[c];
    int32_t c_last = upper[c];
    bound(origin[b] + begin * line.direction[b], origin[b] + last * line.direction[b], b_first, b_last);
    bound(origin[c] + begin * line.direction[c], origin[c] + last * line.direction[c], c_first, c_last);
    for (cell[b] = b_first; cell[b] <= b_last; ++cell[b]) {
      for (cell[c] = c_first; cell[c] <= c_last; ++cell[c]) {
        const float distance = normal.x * (static_cast<float>(cell[b]) + 0.5f) * cell_ +
                               normal.y * (static_cast<float>(cell[c]) + 0.5f) * cell_ - offset;
        if (std::fabs(distance) <= half) visit(cell);
      }
    }
  }
}

void PhotonBeamGrid::build_part(uint32_t part) {
  Slab& slab = slabs_[part];
  const int32_t first = static_cast<int32_t>(part) * layers_of_slab_;
  const int32_t end = std::min(first + layers_of_slab_, size_[axis_]);
  const int b = (axis_ + 1) % 3;
  const int c = (axis_ + 2) % 3;
  slab.first.assign(static_cast<size_t>(layers_of_slab_ * size_[b] * size_[c]) + 1, 0);
  for (const transport::PhotonBeam& line : beams_)
    cells_of(line, first, end, [&](const glm::ivec3& cell) { ++slab.first[cell_in_slab(cell) + 1]; });
  for (size_t i = 1; i < slab.first.size(); ++i) slab.first[i] += slab.first[i - 1];
  slab.beams.resize(slab.first.back());
  std::vector<uint32_t> next(slab.first.begin(), slab.first.end() - 1);
  for (uint32_t i = 0; i < beams_.size(); ++i)
    cells_of(beams_[i], first, end,
             [&](const glm::ivec3& cell) { slab.beams[next[cell_in_slab(cell)]++] = i; });
}

}  // namespace fogbank::integrators
