// Light from records along a segment of a camera path, without noise: look-ups at steps that the records' own
// extents set, radiance linear in between, transmittance in closed form (method.md section 11).
#pragma once

#include <array>
#include <optional>
#include <span>

#include "cache/index.h"
#include "core/random.h"
#include "transport/medium_segment.h"

namespace fogbank::integrators {

/// A look-up along a segment.
struct MarchNode {
  float t = 0;  ///< distance along the segment
  cache::Interpolation found;
  Spectrum radiance{0};  ///< what the records say, or those on both sides across a short gap between them
  bool known = false;    ///< whether there is such
  /// Integral of sigma_s times transmittance times the node's hat function: what a radiance of 1 here,
  /// falling to 0 at the neighbours, adds to what leaves the segment at its origin.
  Spectrum weight{0};
};

/// A place along a segment with the weight of its mean incoming radiance in what leaves the segment.
struct MarchSample {
  float t = 0;
  Spectrum weight{0};
};

/// A place between two distances, drawn by transmittance: one channel's, chosen by weight; expected weight as
/// the light's that is scattered there.
MarchSample sample_distance(const transport::MediumSegment& segment, float first, float last,
                            RandomStream& random);

/// What becomes of records with a shape along the segment; nothing where the phase function is isotropic.
std::optional<cache::ScatteredDirection> scattered_direction(const transport::MediumSegment& segment);

/// Nodes are a function of segment and index only. Lives on the stack: 14 KiB.
class CameraMarch {
 public:
  static constexpr size_t most_nodes = 256;

  /// Of the part [first, last] of the segment; last may be infinite. `index`: null where there are no
  /// records. `widest_step`: where no record reaches, > 0.
  CameraMarch(const transport::MediumSegment& segment, float first, float last, const cache::Index* index,
              const cache::VisibilityTest& visibility, float widest_step);

  /// What becomes of records with a shape; null where the phase function is isotropic.
  const cache::ScatteredDirection* scattered() const { return scattered_ ? &*scattered_ : nullptr; }
  std::span<const MarchNode> nodes() const { return std::span(nodes_).first(count_); }
  /// Somewhere under the hat function of node `number`, with an expected weight of the node's: for estimates
  /// that are to be unbiased however wide the steps are.
  MarchSample sample_around(size_t number, RandomStream& random) const;

 private:
  void place_nodes(const cache::Index* index, const cache::VisibilityTest& visibility, float widest_step);
  void bridge_gaps();
  void weigh();
  MarchSample sample_hat(size_t number, float u) const;
  Spectrum transmittance_at(float t) const;

  const transport::MediumSegment& segment_;
  std::optional<cache::ScatteredDirection> scattered_;
  std::array<MarchNode, most_nodes> nodes_;
  size_t count_ = 0;
  float first_ = 0;
  float last_ = 0;    ///< of the last node
  Spectrum tail_{0};  ///< share of the last node's weight for all that follows it
};

/// Integrals of (1 - s) exp(-x s) and of s exp(-x s) over s in [0, 1], x >= 0: a linear function against the
/// transmittance of a step of optical length x. Relative error below 1e-5.
struct StepWeights {
  float near = 0;
  float far = 0;
};
StepWeights step_weights(float x);

}  // namespace fogbank::integrators
