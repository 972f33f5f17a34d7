// Which records a picture owes its noise to: those get more samples.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "cache/index.h"
#include "integrators/look_up_observer.h"

namespace fogbank::integrators {

/// What the records on some camera rays contribute, ray by ray.
class RecordNoise final : public LookUpObserver {
 public:
  /// Of an index, by the number of its place.
  using Place = std::pair<const cache::Index*, uint32_t>;

  explicit RecordNoise(const cache::Epoch& epoch) : epoch_(&epoch) {}

  void look_up(const LookUp& look_up) override;
  /// The look-ups since the last call were those of one ray.
  void end_ray();
  /// Adds the rays of `other`, seen against the same epoch.
  void append(RecordNoise&& other);

  /// As bytes, and back again: seen against an epoch of the same records and settings. Throws
  /// Error(invalid_argument, "POISONED_RESULT").
  std::string bytes() const;
  static RecordNoise from_bytes(const cache::Epoch& epoch, std::string_view bytes);

  /// Places without which the noise of rays would be at most `error` of their light from records plus a tenth
  /// of its mean: on each ray that is noisier, those with at least half of the mean share. Ascending by
  /// component and number.
  std::vector<Place> noisy(double error) const;

 private:
  struct Ray {
    double luminance = 0;
    std::vector<std::pair<Place, double>> variances;  ///< of the luminance, by record
  };

  const cache::Epoch* epoch_;
  double luminance_ = 0;            ///< of the present ray
  std::map<Place, double> shares_;  ///< of its records
  std::vector<Ray> rays_;
};

}  // namespace fogbank::integrators
