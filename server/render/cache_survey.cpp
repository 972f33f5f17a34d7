#include "render/cache_survey.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

#include "cache/record_bytes.h"
#include "core/error.h"
#include "render/film.h"

namespace fogbank::render {

namespace {

/// Apart from the picture's own random numbers.
constexpr uint32_t survey_stream = 2;

float channel_of(const integrators::CacheView& view, Aov aov) {
  switch (aov) {
    case Aov::radius:
      return view.radius;
    case Aov::record_density:
      return view.record_density;
    case Aov::rejected:
      return view.rejected;
    case Aov::variance:
      return view.variance;
    case Aov::bias:
      return view.bias;
  }
  return 0;
}

/// Where the lattice begins, and how many points it has, along a side of `length` pixels.
std::pair<int32_t, uint32_t> lattice(int32_t length, int32_t stride) {
  const int32_t first = std::min(stride / 2, (length - 1) / 2);
  return {first, static_cast<uint32_t>((length - 1 - first) / stride + 1)};
}

}  // namespace

CacheSurvey::CacheSurvey(const scene::Window& crop, int32_t stride, std::vector<Aov> channels)
    : crop_(crop), stride_(stride), channels_(std::move(channels)) {
  std::tie(first_x_, columns_) = lattice(crop.width, stride);
  std::tie(first_y_, rows_) = lattice(crop.height, stride);
  values_.assign(channels_.size(), std::vector<float>(size_t{columns_} * rows_));
}

std::vector<float> CacheSurvey::look(uint32_t row, const integrators::Integrator& integrator,
                                     const integrators::CameraRays& camera, uint64_t seed,
                                     RayCounters& counters) const {
  std::vector<float> values(channels_.size() * columns_);
  for (uint32_t column = 0; column < columns_; ++column) {
    counters.poll();
    const auto film_x = static_cast<uint32_t>(x(column));
    const auto film_y = static_cast<uint32_t>(y(row));
    RandomStream random(seed, film_x, film_y, 0, survey_stream);
    const Ray ray = camera.sample(film_x, film_y, random);
    const integrators::CacheView view = integrator.cache_view(ray, random, counters);
    for (size_t i = 0; i < channels_.size(); ++i) {
      const float value = channel_of(view, channels_[i]);
      if (!(std::isfinite(value) && value >= 0)) {
        throw Error(ErrorKind::internal, "RESULT_NOT_FINITE",
                    "the cache's " + name_of(channels_[i]) + " in a pixel is " + std::to_string(value));
      }
      values[i * columns_ + column] = to_pixel(static_cast<double>(value));
    }
  }
  return values;
}

void CacheSurvey::set_row(uint32_t row, const std::vector<float>& values) {
  for (size_t i = 0; i < channels_.size(); ++i) {
    std::copy_n(values.begin() + static_cast<std::ptrdiff_t>(i * columns_), columns_,
                values_[i].begin() + static_cast<std::ptrdiff_t>(size_t{row} * columns_));
  }
}

std::vector<float> CacheSurvey::row(uint32_t row) const {
  std::vector<float> values;
  for (const std::vector<float>& channel : values_) {
    const auto first = channel.begin() + static_cast<std::ptrdiff_t>(size_t{row} * columns_);
    values.insert(values.end(), first, first + columns_);
  }
  return values;
}

std::string CacheSurvey::bytes_of(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)};
}

std::vector<float> CacheSurvey::row_values(std::string_view bytes) const {
  std::vector<float> values(channels_.size() * columns_);
  if (bytes.size() != values.size() * sizeof(float)) cache::refuse_poisoned("a row has not its size");
  if (!values.empty()) std::memcpy(values.data(), bytes.data(), bytes.size());
  if (!std::ranges::all_of(values, [](float value) { return std::isfinite(value) && value >= 0; }))
    cache::refuse_poisoned("a value is not finite or is negative");
  return values;
}

}  // namespace fogbank::render
