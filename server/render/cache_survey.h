// What the cache says about pixels: one ray through each of a lattice of them, which lies fixed on the film,
// row by row.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/ray_counters.h"
#include "integrators/integrator.h"
#include "render/render_settings.h"

namespace fogbank::render {

class CacheSurvey {
 public:
  CacheSurvey() = default;
  /// Pixels of the film's `crop` whose coordinates, less the crop's corner, are stride / 2 modulo `stride`
  /// (>= 1), but one at least in either direction.
  CacheSurvey(const scene::Window& crop, int32_t stride, std::vector<Aov> channels);

  uint32_t rows() const { return rows_; }
  uint32_t columns() const { return columns_; }
  int32_t x(uint32_t column) const { return crop_.x + first_x_ + static_cast<int32_t>(column) * stride_; }
  int32_t y(uint32_t row) const { return crop_.y + first_y_ + static_cast<int32_t>(row) * stride_; }
  int32_t stride() const { return stride_; }
  const std::vector<Aov>& channels() const { return channels_; }
  /// Of the given channel, row by row; finite and >= 0.
  const std::vector<float>& values(size_t channel) const { return values_[channel]; }

  /// The values of a row, channel by channel. Throws Interrupted as `counters` says.
  std::vector<float> look(uint32_t row, const integrators::Integrator& integrator,
                          const integrators::CameraRays& camera, uint64_t seed, RayCounters& counters) const;
  /// Any number of rows at a time, by as many threads.
  void set_row(uint32_t row, const std::vector<float>& values);
  /// The values of a row as `look` gives them.
  std::vector<float> row(uint32_t row) const;
  /// A row's values as bytes, and back again. Throws Error(invalid_argument, "POISONED_RESULT").
  static std::string bytes_of(const std::vector<float>& values);
  std::vector<float> row_values(std::string_view bytes) const;

 private:
  scene::Window crop_;
  int32_t stride_ = 1;
  int32_t first_x_ = 0;
  int32_t first_y_ = 0;
  uint32_t columns_ = 0;
  uint32_t rows_ = 0;
  std::vector<Aov> channels_;
  std::vector<std::vector<float>> values_;
};

}  // namespace fogbank::render
