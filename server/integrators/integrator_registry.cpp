// The integrators by name. A new one is its own file and one line here.
#include <string>

#include "core/error.h"
#include "integrators/integrator.h"
#include "integrators/photon_beams.h"
#include "integrators/radiance_cache.h"
#include "integrators/volpath.h"

namespace fogbank::integrators {

namespace {

struct Entry {
  IntegratorInfo info;
  std::unique_ptr<Integrator> (*make)(std::shared_ptr<const transport::World> world,
                                      const IntegratorSettings& settings);
};

const std::vector<Entry>& entries() {
  static const std::vector<Entry> all{
      {{.name = "volpath", .summary = "volumetric path tracing: unbiased, the reference"},
       [](std::shared_ptr<const transport::World> world,
          const IntegratorSettings& settings) -> std::unique_ptr<Integrator> {
         return std::make_unique<VolumetricPathTracer>(std::move(world), settings);
       }},
      {{.name = "radiance-cache",
        .summary = "reflected and scattered light from a cache that sees occlusion; direct light sampled, or "
                   "cached where that is cheaper",
        .cached = true,
        .single_scattering = true},
       [](std::shared_ptr<const transport::World> world,
          const IntegratorSettings& settings) -> std::unique_ptr<Integrator> {
         return std::make_unique<RadianceCacheIntegrator>(std::move(world), settings);
       }},
      {{.name = "radiance-cache-unaware",
        .summary = "the rival: a cache whose derivatives don't see occlusion, of all light that fog scatters",
        .cached = true},
       [](std::shared_ptr<const transport::World> world,
          const IntegratorSettings& settings) -> std::unique_ptr<Integrator> {
         return std::make_unique<RadianceCacheIntegrator>(std::move(world), settings,
                                                          CacheTechnique{.aware = false});
       }},
      {{"photon-beams",
        "progressive photon beams: finds caustics of small lights; blur and noise both go to zero"},
       [](std::shared_ptr<const transport::World> world,
          const IntegratorSettings& settings) -> std::unique_ptr<Integrator> {
         return std::make_unique<PhotonBeamsIntegrator>(std::move(world), settings);
       }},
  };
  return all;
}

}  // namespace

std::unique_ptr<Integrator> make_integrator(const std::string& name,
                                            std::shared_ptr<const transport::World> world,
                                            const IntegratorSettings& settings) {
  std::string known;
  for (const Entry& entry : entries()) {
    if (entry.info.name == name) return entry.make(std::move(world), settings);
    known += (known.empty() ? "" : ", ") + entry.info.name;
  }
  throw Error(ErrorKind::invalid_argument, "UNKNOWN_INTEGRATOR",
              "there is no integrator \"" + name + "\"; known: " + known);
}

std::vector<IntegratorInfo> supported_integrators() {
  std::vector<IntegratorInfo> infos;
  for (const Entry& entry : entries()) infos.push_back(entry.info);
  return infos;
}

}  // namespace fogbank::integrators
