#include "derivatives/form_factor_batch.h"

#include <algorithm>
#include <numbers>

namespace fogbank::derivatives {

namespace {

template <typename Real>
using Vector = std::array<Simd<Real>, 3>;

template <typename Real>
Vector<Real> add(const Vector<Real>& a, const Vector<Real>& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}
template <typename Real>
Vector<Real> subtract(const Vector<Real>& a, const Vector<Real>& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}
template <typename Real>
Simd<Real> dot(const Vector<Real>& a, const Vector<Real>& b) {
  return multiply_add<Real>(a[2], b[2], multiply_add<Real>(a[1], b[1], a[0] * b[0]));
}
/// Two roundings a component rather than a fused difference: exactly antisymmetric.
template <typename Real>
Vector<Real> cross(const Vector<Real>& a, const Vector<Real>& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

/// One vertex of each lane's triangle.
template <typename Real>
struct Corner {
  Vector<Real> direction;
  Simd<Real> inverse_distance;
  Vector<Real> field;  ///< direction / distance^2
};

template <typename Real>
Corner<Real> load_corner(std::span<const BatchVertex<Real>> vertices, const BatchTriangle* triangles,
                         size_t corner) {
  std::array<const Quad<Real>*, simd_lanes<Real>> items;
  for (size_t lane = 0; lane < items.size(); ++lane)
    items[lane] = &vertices[triangles[lane].vertices[corner]].components;
  const auto [x, y, z, inverse_distance] = load_quads(items);
  const Simd<Real> square = inverse_distance * inverse_distance;
  return {{x, y, z}, inverse_distance, {x * square, y * square, z * square}};
}

/// Adds 4 pi times the gradient and Hessian of the directed edge a -> b to `sums`; returns 1 + u_a . u_b.
/// On unit directions 2 u_a x u_b = (u_a + u_b) x (u_b - u_a) and 2 (1 + u_a . u_b) = |u_a + u_b|^2: free of
/// cancellation at all angles, and antisymmetric in a, b.
// Inlined by force: the sums of a triangle's three edges then stay in registers.
template <typename Real, DerivativeOrder order>
[[gnu::always_inline]] inline Simd<Real> add_edge(const Corner<Real>& a, const Corner<Real>& b,
                                                  std::array<Simd<Real>, 10>& sums) {
  const Vector<Real> along = add<Real>(a.direction, b.direction);
  const Simd<Real> square = dot<Real>(along, along);
  if constexpr (order != DerivativeOrder::value) {
    // Opposite directions, i.e. an edge through the point: its term is left out smoothly.
    const Simd<Real> zero{};
    const Real smallest = sizeof(Real) == 4 ? Real(1e-12) : Real(1e-28);
    const Simd<Real> inverse_square = Real(1) / (square > smallest ? square : zero + smallest);
    const Vector<Real> normal = cross<Real>(along, subtract<Real>(b.direction, a.direction));
    const Simd<Real> inverse_sum = a.inverse_distance + b.inverse_distance;
    Vector<Real> left;
    for (size_t axis = 0; axis < 3; ++axis) {
      left[axis] = normal[axis] * inverse_square;
      sums[1 + axis] = multiply_add<Real>(left[axis], inverse_sum, sums[1 + axis]);
    }
    if constexpr (order == DerivativeOrder::hessian) {
      const Simd<Real> pull = (Real(2) * inverse_sum) * (inverse_sum * inverse_square);
      Vector<Real> right;
      for (size_t axis = 0; axis < 3; ++axis)
        right[axis] = multiply_add<Real>(along[axis], pull, a.field[axis] + b.field[axis]);
      // Twice the symmetric part: halved with 4 pi.
      size_t entry = 4;
      for (size_t row = 0; row < 3; ++row)
        for (size_t column = row; column < 3; ++column, ++entry)
          sums[entry] = multiply_add<Real>(left[row], right[column],
                                           multiply_add<Real>(left[column], right[row], sums[entry]));
    }
  }
  return Real(0.5) * square;
}

/// Jets of simd_lanes triangles, entries as in VertexFormFactor.
template <typename Real, DerivativeOrder order>
[[gnu::always_inline]] inline std::array<Simd<Real>, 10> triangle_jets(
    std::span<const BatchVertex<Real>> vertices, const BatchTriangle* triangles) {
  const Corner<Real> c1 = load_corner(vertices, triangles, 0);
  const Corner<Real> c2 = load_corner(vertices, triangles, 1);
  const Corner<Real> c3 = load_corner(vertices, triangles, 2);
  std::array<Simd<Real>, 10> jets{};
  // A and B of method.md section 4.1 on unit vectors.
  Simd<Real> b = add_edge<Real, order>(c1, c2, jets) - Real(2);
  b += add_edge<Real, order>(c2, c3, jets);
  b += add_edge<Real, order>(c3, c1, jets);
  const Simd<Real> a = dot<Real>(c1.direction, cross<Real>(subtract<Real>(c2.direction, c1.direction),
                                                           subtract<Real>(c3.direction, c1.direction)));
  jets[0] = arctangent<Real>(a, b) * (std::numbers::inv_pi_v<Real> / 2);
  constexpr Real inverse_4pi = std::numbers::inv_pi_v<Real> / 4;
  if constexpr (order != DerivativeOrder::value)
    for (size_t i = 1; i < 4; ++i) jets[i] *= inverse_4pi;
  if constexpr (order == DerivativeOrder::hessian)
    for (size_t i = 4; i < 10; ++i) jets[i] *= inverse_4pi / 2;
  return jets;
}

/// Registers of a VertexFormFactor that `order` uses.
template <typename Real>
constexpr size_t used_registers(DerivativeOrder order) {
  const size_t used = order == DerivativeOrder::value ? 1 : (order == DerivativeOrder::gradient ? 4 : 10);
  return (used + simd_lanes<Real> - 1) / simd_lanes<Real>;
}

template <typename Real, DerivativeOrder order>
void gather(std::span<const BatchVertex<Real>> vertices, std::span<const BatchTriangle> triangles,
            std::span<VertexFormFactor<Real>> form_factors, const RayCounters& counters) {
  constexpr size_t lanes = simd_lanes<Real>;
  constexpr size_t registers = used_registers<Real>(order);
  // One over the number of receivers.
  constexpr std::array<Real, 8> shares{0, 1, 1, Real(0.5), 1, Real(0.5), Real(0.5), Real(1) / 3};
  for (size_t first = 0; first < triangles.size(); first += lanes) {
    counters.poll_at(first);
    const size_t count = std::min(lanes, triangles.size() - first);
    const BatchTriangle* block = &triangles[first];
    std::array<BatchTriangle, lanes> tail{};
    if (count < lanes) {
      std::copy_n(block, count, tail.begin());
      block = tail.data();
    }
    const std::array<Simd<Real>, 10> jets = triangle_jets<Real, order>(vertices, block);
    std::array<std::array<Simd<Real>, lanes>, registers> rows{};
    for (size_t i = 0; i < registers; ++i) {
      for (size_t j = 0; j < lanes && i * lanes + j < jets.size(); ++j) rows[i][j] = jets[i * lanes + j];
      rows[i] = transpose(rows[i]);
    }
    for (size_t lane = 0; lane < count; ++lane) {
      const uint32_t receivers = block[lane].receivers;
      const Real share = shares[receivers & BatchTriangle::all];
      for (size_t corner = 0; corner < 3; ++corner) {
        if ((receivers >> corner & 1) == 0) continue;
        auto& sums = form_factors[block[lane].vertices[corner]].registers;
        for (size_t i = 0; i < registers; ++i)
          sums[i] = multiply_add<Real>(rows[i][lane], Simd<Real>{} + share, sums[i]);
      }
    }
  }
}

/// Sums of one channel: w F, w grad F (3), w H F (6); times sigma_t: w F u (3), w (u grad F^T + grad F u^T -
/// F (I - u u^T)/d) (6); times sigma_t^2: w F u u^T (6).
constexpr size_t channel_sums = 25;
template <typename Sum>
using GatherSums = std::array<std::array<Sum, channel_sums>, 3>;

template <typename Real, DerivativeOrder order>
void add_block(const BatchVertex<Real>* vertices, const VertexFormFactor<Real>* form_factors,
               const Spectrum* weights, GatherSums<Simd<Real>>& sums) {
  constexpr size_t lanes = simd_lanes<Real>;
  constexpr size_t registers = used_registers<Real>(order);
  std::array<Simd<Real>, registers * lanes> f;  // entry by entry, a vertex a lane
  for (size_t i = 0; i < registers; ++i) {
    std::array<Simd<Real>, lanes> rows;
    for (size_t lane = 0; lane < lanes; ++lane) rows[lane] = form_factors[lane].registers[i];
    rows = transpose(rows);
    std::copy(rows.begin(), rows.end(), f.begin() + static_cast<std::ptrdiff_t>(i * lanes));
  }
  std::array<Simd<Real>, channel_sums> terms;
  size_t used = 1;
  terms[0] = f[0];
  if constexpr (order != DerivativeOrder::value) {
    std::array<const Quad<Real>*, lanes> items;
    for (size_t lane = 0; lane < lanes; ++lane) items[lane] = &vertices[lane].components;
    const auto [x, y, z, inverse_distance] = load_quads(items);
    const Vector<Real> u{x, y, z};
    used = order == DerivativeOrder::gradient ? 7 : channel_sums;
    for (size_t axis = 0; axis < 3; ++axis) {
      terms[1 + axis] = f[1 + axis];
      terms[4 + axis] = f[0] * u[axis];
    }
    if constexpr (order == DerivativeOrder::hessian) {
      const Simd<Real> curvature = f[0] * inverse_distance;
      size_t entry = 0;
      for (size_t row = 0; row < 3; ++row) {
        for (size_t column = row; column < 3; ++column, ++entry) {
          terms[7 + entry] = f[4 + entry];
          const Simd<Real> mixed =
              multiply_add<Real>(u[row], f[1 + column],
                                 multiply_add<Real>(u[column], f[1 + row], (curvature * u[row]) * u[column]));
          terms[13 + entry] = row == column ? mixed - curvature : mixed;
          terms[19 + entry] = terms[4 + row] * u[column];
        }
      }
    }
  }
  for (size_t channel = 0; channel < 3; ++channel) {
    Simd<Real> weight;
    for (size_t lane = 0; lane < lanes; ++lane)
      weight[lane] = static_cast<Real>(weights[lane][static_cast<int>(channel)]);
    for (size_t i = 0; i < used; ++i)
      sums[channel][i] = multiply_add<Real>(weight, terms[i], sums[channel][i]);
  }
}

template <typename Real, DerivativeOrder order>
GatherSums<double> sum_blocks(std::span<const BatchVertex<Real>> vertices,
                              std::span<const VertexFormFactor<Real>> form_factors,
                              std::span<const Spectrum> weights, const RayCounters& counters) {
  constexpr size_t lanes = simd_lanes<Real>;
  constexpr size_t stretch = 32 * lanes;  // vertices that are summed in Real
  GatherSums<double> totals{};
  for (size_t begin = 0; begin < vertices.size(); begin += stretch) {
    counters.poll();
    GatherSums<Simd<Real>> sums{};
    const size_t end = std::min(begin + stretch, vertices.size());
    size_t i = begin;
    for (; i + lanes <= end; i += lanes)
      add_block<Real, order>(&vertices[i], &form_factors[i], &weights[i], sums);
    if (i < end) {
      std::array<BatchVertex<Real>, lanes> tail_vertices{};
      std::array<VertexFormFactor<Real>, lanes> tail_form_factors{};
      std::array<Spectrum, lanes> tail_weights{};
      std::copy_n(&vertices[i], end - i, tail_vertices.begin());
      std::copy_n(&form_factors[i], end - i, tail_form_factors.begin());
      std::copy_n(&weights[i], end - i, tail_weights.begin());
      add_block<Real, order>(tail_vertices.data(), tail_form_factors.data(), tail_weights.data(), sums);
    }
    for (size_t channel = 0; channel < 3; ++channel)
      for (size_t entry = 0; entry < channel_sums; ++entry)
        for (size_t lane = 0; lane < lanes; ++lane)
          totals[channel][entry] += static_cast<double>(sums[channel][entry][lane]);
  }
  return totals;
}

}  // namespace

template <typename Real>
std::vector<VertexFormFactor<Real>> gather_form_factors(std::span<const BatchVertex<Real>> vertices,
                                                        std::span<const BatchTriangle> triangles,
                                                        DerivativeOrder order, const RayCounters& counters) {
  std::vector<VertexFormFactor<Real>> form_factors(vertices.size());
  switch (order) {
    case DerivativeOrder::value:
      gather<Real, DerivativeOrder::value>(vertices, triangles, form_factors, counters);
      break;
    case DerivativeOrder::gradient:
      gather<Real, DerivativeOrder::gradient>(vertices, triangles, form_factors, counters);
      break;
    case DerivativeOrder::hessian:
      gather<Real, DerivativeOrder::hessian>(vertices, triangles, form_factors, counters);
      break;
  }
  return form_factors;
}

template <typename Real>
RadianceJet gather_radiance(std::span<const BatchVertex<Real>> vertices,
                            std::span<const VertexFormFactor<Real>> form_factors,
                            std::span<const Spectrum> weights, const Spectrum& sigma_t, DerivativeOrder order,
                            const RayCounters& counters) {
  const GatherSums<double> totals =
      order == DerivativeOrder::value
          ? sum_blocks<Real, DerivativeOrder::value>(vertices, form_factors, weights, counters)
          : (order == DerivativeOrder::gradient
                 ? sum_blocks<Real, DerivativeOrder::gradient>(vertices, form_factors, weights, counters)
                 : sum_blocks<Real, DerivativeOrder::hessian>(vertices, form_factors, weights, counters));
  RadianceJet result;
  for (size_t channel = 0; channel < 3; ++channel) {
    const auto& sums = totals[channel];
    const double sigma = static_cast<double>(sigma_t[static_cast<int>(channel)]);
    Jet3d& jet = result.channels[channel];
    jet.value = sums[0];
    for (size_t axis = 0; axis < 3; ++axis)
      jet.gradient[static_cast<int>(axis)] = sums[1 + axis] + sigma * sums[4 + axis];
    for (size_t entry = 0; entry < 6; ++entry)
      jet.hessian.entries[entry] = sums[7 + entry] + sigma * (sums[13 + entry] + sigma * sums[19 + entry]);
  }
  return result;
}

template std::vector<VertexFormFactor<float>> gather_form_factors(std::span<const BatchVertex<float>>,
                                                                  std::span<const BatchTriangle>,
                                                                  DerivativeOrder, const RayCounters&);
template std::vector<VertexFormFactor<double>> gather_form_factors(std::span<const BatchVertex<double>>,
                                                                   std::span<const BatchTriangle>,
                                                                   DerivativeOrder, const RayCounters&);
template RadianceJet gather_radiance(std::span<const BatchVertex<float>>,
                                     std::span<const VertexFormFactor<float>>, std::span<const Spectrum>,
                                     const Spectrum&, DerivativeOrder, const RayCounters&);
template RadianceJet gather_radiance(std::span<const BatchVertex<double>>,
                                     std::span<const VertexFormFactor<double>>, std::span<const Spectrum>,
                                     const Spectrum&, DerivativeOrder, const RayCounters&);

}  // namespace fogbank::derivatives
