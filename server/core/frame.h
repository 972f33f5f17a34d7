// Orthonormal shading frames.
#pragma once

#include "core/vector.h"

namespace fogbank {

/// Right-handed orthonormal basis (tangent, bitangent, normal). Local z is the normal.
struct Frame {
  Vec3f tangent{1, 0, 0};
  Vec3f bitangent{0, 1, 0};
  Vec3f normal{0, 0, 1};

  /// Basis around a unit normal without a branch on direction (Duff et al. 2017, "Building an Orthonormal
  /// Basis, Revisited", listing 3).
  static Frame from_normal(const Vec3f& n) {
    const float sign = std::copysign(1.0f, n.z);
    const float a = -1.0f / (sign + n.z);
    const float b = n.x * n.y * a;
    return {{1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x}, {b, sign + n.y * n.y * a, -n.y}, n};
  }

  /// Basis around a unit normal whose tangent lies along `dp_du` where that is possible (anisotropic BSDFs,
  /// bump maps).
  static Frame from_normal_and_tangent(const Vec3f& n, const Vec3f& dp_du) {
    const Vec3f projected = dp_du - n * glm::dot(n, dp_du);
    const float length_squared = glm::dot(projected, projected);
    if (!(length_squared > 1e-12f * glm::dot(dp_du, dp_du))) return from_normal(n);
    const Vec3f t = projected / std::sqrt(length_squared);
    return {t, glm::cross(n, t), n};
  }

  Vec3f to_local(const Vec3f& v) const {
    return {glm::dot(v, tangent), glm::dot(v, bitangent), glm::dot(v, normal)};
  }
  Vec3f to_world(const Vec3f& v) const { return tangent * v.x + bitangent * v.y + normal * v.z; }
};

}  // namespace fogbank
