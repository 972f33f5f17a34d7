// Which emitted rays matter: a density over the canonical numbers that select them, learnt from paths whose
// effect on a picture is known.
#pragma once

#include <span>
#include <vector>

#include "core/random.h"
#include "transport/light_emission.h"

namespace fogbank::transport {

/// A path that has been tried.
struct EmissionTrial {
  EmissionPoint point{};
  float pdf = 1;         ///< that `point` was drawn with
  float importance = 0;  ///< square root of the variance that the path with its weight causes, >= 0
};

/// Piecewise constant over boxes of a binary tree on [0, 1)^5: primary sample space, whatever the lights
/// (after Guo et al. 2018, "Primary Sample Space Path Guiding"). Immutable.
class EmissionGuide {
 public:
  /// Uniform.
  EmissionGuide();
  /// Learnt. Variance is least where the density follows the root of a path's mean square effect f^2 with
  /// constant weights. Trials drawn with density p have weights 1 / p, so the sum of `importance`^2 p over a
  /// box estimates the integral of f^2, whatever p was. (The sum of `importance`, that of |f|, would be far
  /// too small where few paths matter much: those that a wall sends into a far cloud.) `edges`, from 0 to 1:
  /// no box reaches over one of them in the first dimension.
  EmissionGuide(std::span<const EmissionTrial> trials, std::span<const float> edges);

  struct Sample {
    EmissionPoint point{};
    float pdf = 1;  ///< > 0
  };
  /// `u_box` selects a box, canonical: stratify it over the paths of a pass.
  Sample sample(float u_box, RandomStream& random) const;

 private:
  struct Box {
    EmissionPoint lower{};
    EmissionPoint size{};
    double moment = 0;  ///< integral of the mean square effect, about

    double volume() const;
  };

  void split(std::span<EmissionTrial> trials, const Box& box, size_t first_dimension, double moment_of_split);

  std::vector<Box> boxes_;
  std::vector<float> cumulative_;  ///< from 0 to 1; one more than boxes
};

}  // namespace fogbank::transport
