#include "integrators/record_noise.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "cache/record_bytes.h"

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
  for (const cache::Contribution& one : contributions_to(look_up, *index))
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

std::string RecordNoise::bytes() const {
  // Components once, in front; their numbers in each ray.
  std::map<const cache::Index*, uint16_t> numbers;
  for (const Ray& ray : rays_)
    for (const auto& [place, variance] : ray.variances) numbers.emplace(place.first, 0);
  std::string bytes;
  cache::append_bytes(bytes, static_cast<uint32_t>(numbers.size()));
  uint16_t next = 0;
  for (auto& [index, number] : numbers) {
    number = next++;
    cache::append_component(bytes, index->component());
  }
  cache::append_bytes(bytes, static_cast<uint32_t>(rays_.size()));
  for (const Ray& ray : rays_) {
    cache::append_bytes(bytes, ray.luminance);
    cache::append_bytes(bytes, static_cast<uint32_t>(ray.variances.size()));
    for (const auto& [place, variance] : ray.variances) {
      cache::append_bytes(bytes, numbers.at(place.first));
      cache::append_bytes(bytes, place.second);
      cache::append_bytes(bytes, variance);
    }
  }
  return bytes;
}

RecordNoise RecordNoise::from_bytes(const cache::Epoch& epoch, std::string_view bytes) {
  constexpr size_t least_ray_bytes = 12;
  constexpr size_t variance_bytes = 14;
  cache::ByteReader reader(bytes);
  const auto finite = [&] {
    const auto value = reader.take<double>();
    if (!std::isfinite(value) || value < 0) cache::refuse_poisoned("a noise is not finite");
    return value;
  };
  std::vector<const cache::Index*> indices(cache::take_count(reader, cache::component_bytes));
  for (const cache::Index*& index : indices) {
    index = epoch.find(cache::take_component(reader));
    if (index == nullptr) cache::refuse_poisoned("a component has no records");
  }
  RecordNoise noise(epoch);
  noise.rays_.resize(cache::take_count(reader, least_ray_bytes));
  for (Ray& ray : noise.rays_) {
    ray.luminance = finite();
    const uint32_t count = cache::take_count(reader, variance_bytes);
    ray.variances.reserve(count);
    for (uint32_t i = 0; i < count; ++i) {
      const auto number = reader.take<uint16_t>();
      const auto place = reader.take<uint32_t>();
      if (number >= indices.size() || place >= indices[number]->range().place_count)
        cache::refuse_poisoned("there is no such place");
      ray.variances.emplace_back(Place{indices[number], place}, finite());
    }
  }
  cache::expect_end(reader);
  return noise;
}

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
