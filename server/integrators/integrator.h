// The interface of integrators: radiance along a camera ray. One file per integrator, one line in
// integrator_registry.cpp.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/random.h"
#include "core/ray_counters.h"
#include "core/vector.h"

namespace fogbank::transport {
class World;
}

namespace fogbank::integrators {

struct IntegratorSettings {
  int32_t max_depth =
      -1;  ///< path length in edges, as Mitsuba's: 1 = emitted light only, 2 = one bounce; -1 = unbounded
  int32_t rr_depth = 2;  ///< Russian roulette by throughput from this depth on
  bool hide_emitters = false;
};

/// Immutable; one instance serves all threads.
class Integrator {
 public:
  virtual ~Integrator() = default;
  /// One sample of the radiance (linear sRGB, finite, >= 0) that arrives along `ray`. Draws only from
  /// `random`.
  virtual Spectrum radiance(const Ray& ray, RandomStream& random, RayCounters& counters) const = 0;
};

/// Throws Error(invalid_argument, "UNKNOWN_INTEGRATOR") naming the known ones.
std::unique_ptr<Integrator> make_integrator(const std::string& name,
                                            std::shared_ptr<const transport::World> world,
                                            const IntegratorSettings& settings);

struct IntegratorInfo {
  std::string name;
  std::string summary;
};
std::vector<IntegratorInfo> supported_integrators();

}  // namespace fogbank::integrators
