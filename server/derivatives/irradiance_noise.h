// What the spread of neighbouring rays of a hemisphere tells about noise.
#pragma once

#include <span>

#include "derivatives/hemisphere_grid.h"

namespace fogbank::derivatives {

/// Variance of the luminance of the mean of stratified samples, one a cell: half the squared difference of
/// two neighbours estimates the variance of each, and counts what differs between their strata as noise,
/// which is on the safe side.
double variance_of_mean(std::span<const Spectrum> radiance);

/// Variance of the sum over cells of luminance times `shares` (a vector each; its components are added up).
/// The radiance of a cell is as uncertain as it differs from that of its neighbours on the same surface
/// (equal numbers in `surfaces`).
double variance_of_sum(const HemisphereGrid& grid, std::span<const uint32_t> surfaces,
                       std::span<const Spectrum> radiance, std::span<const Vec3f> shares);

}  // namespace fogbank::derivatives
