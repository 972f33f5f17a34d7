// What the cache says along a camera ray: how records lie there and how far they can be trusted.
#include <algorithm>
#include <cmath>
#include <map>

#include "integrators/radiance_cache.h"

namespace fogbank::integrators {

namespace {

/// Share of the metric's bound that is the error: bounds are for the worst direction at every look-up.
constexpr double error_per_bound = 0.3;
/// Neighbours err alike to some degree, so they disagree less than they err. Chosen: with it, estimates of
/// five pictures with known errors are 0.95 to 1.12 of those (tests/oracle/test_radiance_cache.py).
constexpr double error_per_disagreement = 2.0;

class ViewSums final : public LookUpObserver {
 public:
  explicit ViewSums(const cache::Epoch& epoch) : epoch_(epoch) {}

  void look_up(const LookUp& look_up) override {
    const auto weight = static_cast<double>(luminance(look_up.weight));
    const cache::Index* index = epoch_.find(look_up.place.component);
    if (!(weight > 0) || index == nullptr) return;
    weight_ += weight;
    records_ += weight * look_up.found.records;
    rejected_ += weight * look_up.found.rejected;
    radius_ += weight * static_cast<double>(look_up.found.radius);
    if (look_up.found.weight > 0) compare(look_up, *index, weight);
  }

  CacheView view() const {
    if (!(weight_ > 0)) return {};
    // A record speaks at many places of a ray, and errs alike at all of them.
    double variance = 0;
    double checked_variance = 0;
    double disagreement = 0;
    for (const auto& [record, sums] : sums_) {
      const auto of_record =
          static_cast<double>(epoch_.records().place(record.first->range(), record.second).variance);
      variance += (sums.checked + sums.unchecked) * (sums.checked + sums.unchecked) * of_record;
      checked_variance += sums.checked * sums.checked * of_record;
      disagreement += sums.difference * sums.difference;
    }
    const double square = std::max(disagreement - checked_variance, 0.0) + bound_ * bound_;
    return {.radius = static_cast<float>(radius_ / weight_),
            .record_density = static_cast<float>(records_ / weight_),
            .rejected = static_cast<float>(rejected_ / weight_),
            .variance = static_cast<float>(variance),
            .bias = static_cast<float>(error_per_disagreement * std::sqrt(square))};
  }

 private:
  struct RecordSums {
    double checked = 0;     ///< weight where others speak too
    double unchecked = 0;   ///< where none does
    double difference = 0;  ///< weighted, from what the others say
  };

  /// What overlapping records disagree about is what they don't know: noise and errors of extrapolation
  /// alike. A record alone has the metric's bound, as far as that says anything: noise may blow up second
  /// derivatives.
  void compare(const LookUp& look_up, const cache::Index& index, double weight) {
    const std::vector<cache::Contribution> contributions = contributions_to(look_up, index);
    std::vector<double> claims;
    double blend = 0;
    for (const cache::Contribution& one : contributions) {
      const cache::Place place = epoch_.records().place(index.range(), one.place);
      const Vec3f offset = look_up.place.position - place.position;
      const auto claim =
          static_cast<double>(luminance(index.extrapolated_by(one.place, offset, look_up.scattered)));
      claims.push_back(claim);
      blend += claim * static_cast<double>(one.weight / look_up.found.weight);
      if (contributions.size() == 1)
        bound_ +=
            weight * error_per_bound *
            std::min(static_cast<double>(0.5f * place.hessian.norm() * glm::dot(offset, offset)), claim);
    }
    for (size_t i = 0; i < contributions.size(); ++i) {
      const auto share = static_cast<double>(contributions[i].weight / look_up.found.weight);
      RecordSums& sums = sums_[{&index, contributions[i].place}];
      if (!(share < 1)) {
        sums.unchecked += weight * share;
        continue;
      }
      sums.checked += weight * share;
      // The difference from the others has the variance of both: of n alike, n / (n - 1) times a record's
      // own.
      const double others = (blend - share * claims[i]) / (1 - share);
      sums.difference += weight * share * (claims[i] - others) * std::sqrt(1 - share);
    }
  }

  const cache::Epoch& epoch_;
  double weight_ = 0;
  double radius_ = 0;
  double records_ = 0;
  double rejected_ = 0;
  double bound_ = 0;
  std::map<std::pair<const cache::Index*, uint32_t>, RecordSums> sums_;
};

}  // namespace

CacheView RadianceCacheIntegrator::cache_view(const Ray& ray, RandomStream& random,
                                              RayCounters& counters) const {
  if (!published_.epoch) return {};
  ViewSums sums(*published_.epoch);
  observe(ray, random, counters, sums);
  return sums.view();
}

}  // namespace fogbank::integrators
