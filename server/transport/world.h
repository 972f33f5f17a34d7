// A scene made ready for light transport: BSDFs, emitters, phase functions and the light sampler built over
// `scene::Scene`.
#pragma once

#include <memory>
#include <vector>

#include "scene/scene.h"
#include "transport/bsdf.h"

namespace fogbank::transport {

class World {
 public:
  /// Builds everything `scene` describes. Throws SceneError as `BsdfBuilder` and the emitters do; lenient
  /// scenes get their substitutions' warnings appended to `scene->warnings`.
  explicit World(std::shared_ptr<scene::Scene> scene);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  const scene::Scene& scene() const { return *scene_; }
  const Bsdf& bsdf(uint32_t shape) const { return *bsdfs_[static_cast<size_t>(scene_->shapes[shape].bsdf)]; }

 private:
  std::shared_ptr<scene::Scene> scene_;
  std::vector<BsdfPointer> bsdfs_;
};

}  // namespace fogbank::transport
