// What the cache says along a camera ray: how records lie there and how far they can be trusted.
#include <map>

#include "integrators/radiance_cache.h"

namespace fogbank::integrators {

namespace {

/// Share of the metric's bound that is the error: bounds are for the worst direction at every look-up.
constexpr double error_per_bound = 0.3;

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
    if (!(look_up.found.weight > 0)) return;
    const cache::RecordSet& set = epoch_.records();
    for (const cache::Contribution& one :
         index->contributions(look_up.place.position, look_up.place.normal)) {
      const double share = weight * static_cast<double>(one.weight / look_up.found.weight);
      shares_[{index, one.place}] += share;
      const cache::Place place = set.place(index->range(), one.place);
      const Vec3f offset = look_up.place.position - place.position;
      bound_ += share * static_cast<double>(0.5f * place.hessian.norm() * glm::dot(offset, offset));
    }
  }

  CacheView view() const {
    if (!(weight_ > 0)) return {};
    // A record speaks at many places of a ray, and errs alike at all of them.
    double variance = 0;
    for (const auto& [place, share] : shares_)
      variance += share * share *
                  static_cast<double>(epoch_.records().place(place.first->range(), place.second).variance);
    return {.radius = static_cast<float>(radius_ / weight_),
            .record_density = static_cast<float>(records_ / weight_),
            .rejected = static_cast<float>(rejected_ / weight_),
            .variance = static_cast<float>(variance),
            .bias = static_cast<float>(error_per_bound * bound_)};
  }

 private:
  const cache::Epoch& epoch_;
  double weight_ = 0;
  double radius_ = 0;
  double records_ = 0;
  double rejected_ = 0;
  double bound_ = 0;
  std::map<std::pair<const cache::Index*, uint32_t>, double> shares_;
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
