// `<transform>` elements.
#pragma once

#include "core/vector.h"
#include "scene/xml/document.h"

namespace fogbank::scene {

/// Product of the element's steps; each step applies after those above it. Steps: translate, scale (x, y, z
/// or value), rotate (axis and angle in degrees), lookat (origin, target, up: maps +z to the view direction,
/// +y to up), matrix (16 numbers row by row, or 9 for the linear part). Throws SceneError INVALID_TRANSFORM
/// for numbers that are not finite or above LoadLimits::coordinate, a singular or projective result, a
/// degenerate axis or view.
Mat4d read_transform(const XmlElement& transform);

/// x, y and z attributes, or a `value` of one or three numbers. Throws SceneError INVALID_VALUE.
Vec3d read_vector(const XmlElement& element, double fallback);

}  // namespace fogbank::scene
