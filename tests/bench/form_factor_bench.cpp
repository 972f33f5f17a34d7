// Nanoseconds a triangle of the batch of form factors, by number of derivatives and precision, beside
// triangles one at a time and the multiply-add peak of the same core; run.py divides. A grid of 2048
// triangles is what a record has: it fits a second-level cache.
//
// Roofline, batch in float with Hessians: about 330 operations a triangle (3 edges of 68, arctangent 24, the
// rest 49, adding to 3 vertices 60), counting a fused multiply-add as two. Bytes a triangle: 16 of indices, 8
// of vertices (each serves six triangles), 64 of sums read and written, hence 3.7 operations a byte. With 64
// bytes a cycle from the second-level cache the memory would allow 240 operations a cycle and the arithmetic
// 32: bound by arithmetic. Of that, a third of the operations come in fused pairs, 72 shuffles a register of
// triangles (gathering corners, scattering sums) share ports with them, and one triangle needs four
// divisions: a quarter of peak is the goal.
#include <benchmark/benchmark.h>

#include "derivatives/closed_surroundings.h"
#include "derivatives/form_factor_batch.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {
namespace {

template <typename Real>
struct Fixture {
  std::vector<BatchVertex<Real>> vertices;
  std::vector<BatchTriangle> triangles;
  std::vector<Spectrum> weights;
  std::vector<RelativeTriangle<Real>> singles;

  Fixture() {
    RandomStream random(1, 2, 3, 4);
    const test::Surroundings surroundings = test::closed_surroundings(random, 4, 0.02, 1, 10);
    for (size_t i = 0; i < surroundings.directions.size(); ++i) {
      vertices.emplace_back(glm::vec<3, Real>(surroundings.directions[i]),
                            static_cast<Real>(1 / surroundings.distances[i]));
      weights.emplace_back(random.next_float(), random.next_float(), random.next_float());
    }
    for (const auto& corners : surroundings.triangles) {
      triangles.push_back({corners, random.next_float() < 0.1f ? 1 : BatchTriangle::all});
      singles.push_back(
          RelativeTriangle<Real>::from_relative(glm::vec<3, Real>(surroundings.position(corners[0])),
                                                glm::vec<3, Real>(surroundings.position(corners[1])),
                                                glm::vec<3, Real>(surroundings.position(corners[2]))));
    }
  }
};

template <typename Real>
const Fixture<Real>& fixture() {
  static const Fixture<Real> shared;
  return shared;
}

template <typename Real>
void batch(benchmark::State& state) {
  const Fixture<Real>& f = fixture<Real>();
  const auto order = static_cast<DerivativeOrder>(state.range(0));
  for (auto _ : state) benchmark::DoNotOptimize(gather_form_factors<Real>(f.vertices, f.triangles, order));
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(f.triangles.size()));
}

/// The product rule and the sum over vertices; items are triangles too, so that both add up.
template <typename Real>
void radiance(benchmark::State& state) {
  const Fixture<Real>& f = fixture<Real>();
  const auto order = static_cast<DerivativeOrder>(state.range(0));
  const auto form_factors = gather_form_factors<Real>(f.vertices, f.triangles, order);
  for (auto _ : state)
    benchmark::DoNotOptimize(
        gather_radiance<Real>(f.vertices, form_factors, f.weights, Spectrum(0.1f, 0.2f, 0.4f), order));
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(f.triangles.size()));
}

template <typename Real>
void one_value(benchmark::State& state) {
  for (auto _ : state)
    for (const auto& triangle : fixture<Real>().singles)
      benchmark::DoNotOptimize(triangle_form_factor(triangle));
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(fixture<Real>().singles.size()));
}

template <typename Real>
void one_jet(benchmark::State& state) {
  for (auto _ : state)
    for (const auto& triangle : fixture<Real>().singles)
      benchmark::DoNotOptimize(triangle_form_factor_jet(triangle));
  state.SetItemsProcessed(state.iterations() * static_cast<int64_t>(fixture<Real>().singles.size()));
}

/// Independent fused multiply-adds, enough to hide their latency; an item is one operation.
template <typename Real>
void peak(benchmark::State& state) {
  constexpr size_t chains = 12;
  constexpr int64_t rounds = 1000;
  std::array<Simd<Real>, chains> sums{};
  Simd<Real> factor = Simd<Real>{} + Real(0.999);
  benchmark::DoNotOptimize(factor);
  for (auto _ : state) {
    for (int64_t round = 0; round < rounds; ++round)
      for (Simd<Real>& sum : sums) sum = multiply_add<Real>(sum, factor, factor);
    benchmark::DoNotOptimize(sums);
  }
  state.SetItemsProcessed(state.iterations() * rounds * static_cast<int64_t>(chains * 2 * simd_lanes<Real>));
}

BENCHMARK(batch<float>)->ArgName("derivatives")->DenseRange(0, 2);
BENCHMARK(batch<double>)->ArgName("derivatives")->DenseRange(0, 2);
BENCHMARK(radiance<float>)->ArgName("derivatives")->DenseRange(0, 2);
BENCHMARK(radiance<double>)->ArgName("derivatives")->DenseRange(0, 2);
BENCHMARK(one_value<float>);
BENCHMARK(one_value<double>);
BENCHMARK(one_jet<float>);
BENCHMARK(one_jet<double>);
BENCHMARK(peak<float>);
BENCHMARK(peak<double>);

}  // namespace
}  // namespace fogbank::derivatives

BENCHMARK_MAIN();
