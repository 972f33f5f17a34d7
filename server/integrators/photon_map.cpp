#include "integrators/photon_map.h"

#include <algorithm>
#include <bit>

namespace fogbank::integrators {

namespace {

constexpr float largest_coordinate = 1e9f;

}  // namespace

PhotonMap::PhotonMap(const std::vector<transport::SurfacePhoton>& photons, float radius)
    : radius_(radius), inverse_cell_(0.5f / radius) {
  const auto count = static_cast<uint32_t>(photons.size());
  slot_mask_ = std::bit_ceil(std::max(count, 1u)) - 1;
  first_.assign(size_t{slot_mask_} + 2, 0);
  for (const transport::SurfacePhoton& photon : photons) ++first_[slot_of(cell_of(photon.position)) + 1];
  for (size_t slot = 1; slot < first_.size(); ++slot) first_[slot] += first_[slot - 1];
  photons_.resize(count);
  std::vector<uint32_t> next(first_.begin(), first_.end() - 1);
  for (const transport::SurfacePhoton& photon : photons)
    photons_[next[slot_of(cell_of(photon.position))]++] = photon;
}

PhotonMap::Cell PhotonMap::cell_of(const Vec3f& position) const {
  const Vec3f scaled =
      glm::clamp(glm::floor(position * inverse_cell_), -largest_coordinate, largest_coordinate);
  return {static_cast<int32_t>(scaled.x), static_cast<int32_t>(scaled.y), static_cast<int32_t>(scaled.z)};
}

uint32_t PhotonMap::slot_of(const Cell& cell) const {
  // Odd multipliers with well mixed high digits, folded down.
  uint32_t hash = static_cast<uint32_t>(cell[0]) * 0x9E3779B1u;
  hash ^= static_cast<uint32_t>(cell[1]) * 0x85EBCA77u;
  hash ^= static_cast<uint32_t>(cell[2]) * 0xC2B2AE3Du;
  hash ^= hash >> 15;
  hash *= 0x2C1B3C6Du;
  hash ^= hash >> 13;
  return hash & slot_mask_;
}

}  // namespace fogbank::integrators
