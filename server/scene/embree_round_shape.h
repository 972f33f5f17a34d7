// Round shapes as Embree's user geometry. For embree_*.cpp alone.
#pragma once

#include <embree3/rtcore.h>

#include "scene/round_shape.h"

namespace fogbank::scene {

/// Makes `geometry`, of type RTC_GEOMETRY_TYPE_USER, stand for `shape`, which must outlive it.
void set_round_shape(RTCGeometry geometry, const RoundShape& shape);

}  // namespace fogbank::scene
