// The kinds of lights that light_grid.cpp makes grids of; one file each.
#pragma once

#include "derivatives/light_grid.h"

namespace fogbank::derivatives {

GriddedLightPointer grid_rectangle(const transport::RectangleShape& shape, double least_distance);

}  // namespace fogbank::derivatives
