// Photons on surfaces, found around a point: a hashed grid of cells twice the radius wide.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "transport/photon_tracer.h"

namespace fogbank::integrators {

/// Memory: 60 to 68 bytes a photon.
class PhotonMap {
 public:
  /// `radius` > 0, scene units.
  PhotonMap(const std::vector<transport::SurfacePhoton>& photons, float radius);

  float radius() const { return radius_; }
  size_t size() const { return photons_.size(); }
  /// Calls visit(photon, distance squared) for every photon within `radius` of `position`, in an order that
  /// depends on nothing but photons and position.
  template <typename Visit>
  void find(const Vec3f& position, Visit&& visit) const;

 private:
  /// Cells are counted in whole numbers as far as floats hold them.
  using Cell = std::array<int32_t, 3>;
  Cell cell_of(const Vec3f& position) const;
  uint32_t slot_of(const Cell& cell) const;

  float radius_;
  float inverse_cell_;
  uint32_t slot_mask_ = 0;
  std::vector<uint32_t> first_;  ///< of each slot; one more than slots
  std::vector<transport::SurfacePhoton> photons_;
};

template <typename Visit>
void PhotonMap::find(const Vec3f& position, Visit&& visit) const {
  if (photons_.empty()) return;
  const Cell from = cell_of(position - radius_);
  const Cell to = cell_of(position + radius_);
  for (int32_t x = from[0]; x <= to[0]; ++x) {
    for (int32_t y = from[1]; y <= to[1]; ++y) {
      for (int32_t z = from[2]; z <= to[2]; ++z) {
        const Cell cell{x, y, z};
        const uint32_t slot = slot_of(cell);
        for (uint32_t i = first_[slot]; i < first_[slot + 1]; ++i) {
          const transport::SurfacePhoton& photon = photons_[i];
          const Vec3f offset = photon.position - position;
          const float distance_squared = glm::dot(offset, offset);
          // Other cells share the slot.
          if (distance_squared < radius_ * radius_ && cell_of(photon.position) == cell)
            visit(photon, distance_squared);
        }
      }
    }
  }
}

}  // namespace fogbank::integrators
