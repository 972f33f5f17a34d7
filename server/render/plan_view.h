// A scene cut open at a height and seen from above, as an architect draws it.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/vector.h"
#include "scene/scene.h"

namespace fogbank::render {

struct PlanRequest {
  int32_t side = 1024;             ///< pixels of the longer side, >= 1
  std::optional<double> cut;       ///< world coordinate along the up axis; default: the median of `points`
  std::optional<int32_t> up_axis;  ///< 0, 1, 2; default: the axis nearest to the scene's camera's up
};

/// Square pixels, row by row from the top.
struct PlanView {
  int32_t width = 0;
  int32_t height = 0;
  int32_t right_axis = 0;  ///< world axes that point to the right, down, and to the viewer
  int32_t down_axis = 0;
  int32_t up_axis = 0;
  double left = 0;  ///< world coordinates of the upper left corner
  double top = 0;
  double pixel_size = 0;  ///< scene units
  double cut = 0;
  std::vector<float> depth;    ///< how far below the cut the first solid surface is; infinity: none
  std::vector<float> facing;   ///< cosine between its normal and the up axis, 0 to 1; 0: none
  std::vector<uint8_t> solid;  ///< 1 where the cut goes through a solid object
};

/// The part of the scene around its surfaces and `points`, which lie in free space: what encloses one of them
/// is a room and no solid object. Throws Error(invalid_argument, "INVALID_VIEW") naming the field.
PlanView plan_view(const scene::Scene& scene, std::span<const Vec3f> points, const PlanRequest& request);

}  // namespace fogbank::render
