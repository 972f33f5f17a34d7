// The mean radiance that photons leave behind in the media of a scene: what records gather instead of tracing
// paths through dense fog to their end.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/ray_counters.h"
#include "transport/light_emission.h"
#include "transport/photon_tracer.h"
#include "transport/world.h"

namespace fogbank::cache {

/// A grid of cubic cells over each medium that scatters. Light that was scattered before and passes through a
/// cell adds its flux times its way within (the track length estimator of fluence: Spanier and Gelbard 1969,
/// "Monte Carlo Principles and Neutron Transport Problems", chapter 3). Cells that a surface or a boundary of
/// the medium crosses are not used: whoever asks there goes on with a path, so nothing leaks through walls.
/// What is left is the mean over a few cells instead of the value at a point, and noise that is shared by all
/// who ask. A function of the scene, `paths` and `max_depth`, whatever the threads.
class PhotonField final : public transport::KnownRadiance {
 public:
  /// `paths` >= 1 of photons. `max_depth`: edges of a whole path, -1: unbounded. Needs
  /// scene::prepare_render_thread, as all that follows.
  PhotonField(std::shared_ptr<const transport::World> world, uint32_t paths, int32_t max_depth);

  /// Traces the photons unless that is done: threads that come at the same time share the work. Before any
  /// look-up. Throws Interrupted; what was traced by then stays.
  void complete(RayCounters& counters);

  uint32_t paths() const { return paths_; }
  /// nullopt where cells around hold more than the medium.
  std::optional<Spectrum> scattered_before(const Vec3f& y, int32_t medium) const override;

 private:
  struct Grid {
    Vec3f lower{0};
    float cell = 0;      ///< side
    glm::ivec3 size{0};  ///< cells
    std::vector<Spectrum> radiance;
    /// Whether cells hold nothing but the medium: found out when first asked.
    mutable std::vector<std::atomic<uint8_t>> clear{};

    size_t number(const glm::ivec3& c) const {
      return (static_cast<size_t>(c.z) * static_cast<size_t>(size.y) + static_cast<size_t>(c.y)) *
                 static_cast<size_t>(size.x) +
             static_cast<size_t>(c.x);
    }
  };

  /// One medium's sums of flux times way, by cell.
  using Sums = std::vector<Spectrum>;
  enum class Share : uint8_t { open, taken, traced };

  std::vector<Sums> trace(uint32_t share, RayCounters& counters) const;
  void finish();
  void splat(const transport::PhotonBeam& beam, const Grid& grid, Sums& sums) const;
  bool is_clear(const Grid& grid, const glm::ivec3& cell, int32_t medium) const;

  std::shared_ptr<const transport::World> world_;
  uint32_t paths_;
  transport::LightEmission emission_;
  transport::PhotonTracer tracer_;
  std::vector<Grid> grids_;  ///< by medium; empty ones hold nothing

  std::atomic<bool> complete_ = false;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Share> shares_;              ///< of the photons
  std::vector<std::vector<Sums>> traced_;  ///< by share and medium
};

/// For the ids of records: what their light comes from. `photons` may be null.
std::string described(const PhotonField* photons);

}  // namespace fogbank::cache
