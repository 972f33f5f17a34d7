#include "integrators/record_noise.h"

#include <algorithm>
#include <iterator>
#include <set>

namespace fogbank::integrators {

namespace {

/// Of the mean ray's luminance: what is darker need not be cleaner than this.
constexpr double darkest_share = 0.1;

}  // namespace

void RecordNoise::look_up(const LookUp& look_up) {
  const cache::Index* index = epoch_->find(look_up.place.component);
  const auto weight = static_cast<double>(luminance(look_up.weight));
  if (index == nullptr || !(weight > 0) || !(look_up.found.weight > 0)) return;
  luminance_ += static_cast<double>(luminance(look_up.weight * look_up.found.radiance));
  for (const cache::Contribution& one : index->contributions(look_up.place.position, look_up.place.normal))
    shares_[{index, one.place}] += weight * static_cast<double>(one.weight / look_up.found.weight);
}

void RecordNoise::end_ray() {
  if (shares_.empty()) return;
  Ray& ray = rays_.emplace_back();
  ray.luminance = std::exchange(luminance_, 0);
  for (const auto& [place, share] : shares_) {
    const auto variance =
        static_cast<double>(epoch_->records().place(place.first->range(), place.second).variance);
    ray.variances.emplace_back(place, share * share * variance);
  }
  shares_.clear();
}

void RecordNoise::append(RecordNoise&& other) { std::ranges::move(other.rays_, std::back_inserter(rays_)); }

std::vector<RecordNoise::Place> RecordNoise::noisy(double error) const {
  double mean = 0;
  for (const Ray& ray : rays_) mean += ray.luminance / static_cast<double>(rays_.size());
  // Indices lie in the order of their components.
  std::set<Place> places;
  for (const Ray& ray : rays_) {
    double variance = 0;
    for (const auto& [place, share] : ray.variances) variance += share;
    const double tolerable = error * (ray.luminance + darkest_share * mean);
    if (!(variance > tolerable * tolerable)) continue;
    const double least = 0.5 * variance / static_cast<double>(ray.variances.size());
    for (const auto& [place, share] : ray.variances)
      if (share >= least) places.insert(place);
  }
  return {places.begin(), places.end()};
}

}  // namespace fogbank::integrators
