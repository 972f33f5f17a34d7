// Form factors of the thousands of triangles of a direction grid, with their derivatives, and the radiance
// that they gather: the hot loop of a record. Single triangles: triangle_form_factor.h.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "core/ray_counters.h"
#include "derivatives/radiance_jet.h"
#include "derivatives/simd.h"

namespace fogbank::derivatives {

/// A vertex of a direction grid as seen from the point: its direction (unit length) and 1/distance, >= 0. 0
/// is allowed: infinitely far, without parallax.
template <typename Real>
struct alignas(4 * sizeof(Real)) BatchVertex {
  Quad<Real> components{};  ///< direction x, y, z; inverse distance

  BatchVertex() = default;
  BatchVertex(const glm::vec<3, Real>& direction, Real inverse_distance)
      : components{direction.x, direction.y, direction.z, inverse_distance} {}
  glm::vec<3, Real> direction() const { return {components[0], components[1], components[2]}; }
  Real inverse_distance() const { return components[3]; }
};

/// A triangle, counter-clockwise as seen from the point where its form factor is positive, and which of its
/// vertices share it equally: all three under the mean rule, the farthest alone on slanted ones (method.md
/// sections 2 and 5), those alive in a shell (section 8.1).
struct BatchTriangle {
  std::array<uint32_t, 3> vertices;
  uint32_t receivers;  ///< bit i: vertex i; 0: the triangle counts nowhere

  static constexpr uint32_t all = 0b111;
};

/// Jet of the form factor that a vertex stands for, sum over triangles of share times F: value, gradient,
/// Hessian (xx, xy, xz, yy, yz, zz), padded to whole registers.
template <typename Real>
struct VertexFormFactor {
  std::array<Simd<Real>, 16 / simd_lanes<Real>> registers{};

  Real entry(size_t i) const { return registers[i / simd_lanes<Real>][i % simd_lanes<Real>]; }
  Jet<Real, 3> jet() const {
    return {entry(0),
            {entry(1), entry(2), entry(3)},
            {{entry(4), entry(5), entry(6), entry(7), entry(8), entry(9)}}};
  }
};

/// The form factors of all vertices, hence of a whole radiance field: by linearity
/// sum_t F_t sum_i share_ti L_i T_i = sum_i L_i T_i (sum_t share_ti F_t), so that the product rule is needed
/// once a vertex instead of once a triangle, corner and channel.
///
/// Edge form (method.md section 4.3) on unit directions. An edge between two triangles gets the same term,
/// negated, in both, to the bit: errors of a closed sum with constant weights are those of adding up. Errors
/// of one F_t: value 5 ulp + 1 ulp / (angular size), gradient and Hessian those of the edge form, 1 ulp /
/// (angular size) and its square. Float is meant for direction grids; lights that are small and far need
/// doubles. `triangles` must not use an index beyond `vertices`. Results don't depend on the instruction set.
/// What `order` doesn't ask for is 0. Finite for unit directions and finite inverse distances up to 1e18
/// (float). Throws Interrupted.
template <typename Real>
std::vector<VertexFormFactor<Real>> gather_form_factors(std::span<const BatchVertex<Real>> vertices,
                                                        std::span<const BatchTriangle> triangles,
                                                        DerivativeOrder order,
                                                        const RayCounters& counters = {});

/// sum_i w_i T_i(x) / T_i Phi_i with its derivatives, per channel, in a homogeneous medium: `weights` are
/// radiance times transmittance at the vertices, `sigma_t` >= 0 in 1/length per channel (method.md section
/// 5). Blocks are summed in Real, blocks of blocks in double. All spans have one entry a vertex. Throws
/// Interrupted.
template <typename Real>
RadianceJet gather_radiance(std::span<const BatchVertex<Real>> vertices,
                            std::span<const VertexFormFactor<Real>> form_factors,
                            std::span<const Spectrum> weights, const Spectrum& sigma_t, DerivativeOrder order,
                            const RayCounters& counters = {});

}  // namespace fogbank::derivatives
