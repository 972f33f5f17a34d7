// Vectors, colours and matrices: GLM's types under the names the renderer uses.
#pragma once

#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>

namespace fogbank {

using Vec2f = glm::vec2;
using Vec3f = glm::vec3;
using Vec2d = glm::dvec2;
using Vec3d = glm::dvec3;
using Vec2i = glm::ivec2;
using Vec2u = glm::uvec2;
using Vec3u = glm::uvec3;
using Mat3f = glm::mat3;
using Mat4d = glm::dmat4;

/// Linear sRGB triple (ITU-R BT.709 primaries): a radiance, a reflectance or a coefficient per channel.
using Spectrum = glm::vec3;

inline constexpr float pi = 3.14159265358979323846f;
inline constexpr float inv_pi = 0.31830988618379067154f;
inline constexpr float inv_4pi = 0.07957747154594766788f;
inline constexpr float infinity = std::numeric_limits<float>::infinity();
/// Largest float below 1, so that a canonical random number never reaches 1.
inline constexpr float one_minus_epsilon = 0x1.fffffep-1f;

inline float max_component(const Vec3f& v) { return std::fmax(v.x, std::fmax(v.y, v.z)); }
inline float min_component(const Vec3f& v) { return std::fmin(v.x, std::fmin(v.y, v.z)); }
inline float mean(const Spectrum& s) { return (s.x + s.y + s.z) * (1.0f / 3.0f); }

/// Relative luminance of linear sRGB (ITU-R BT.709).
inline float luminance(const Spectrum& s) { return 0.212671f * s.x + 0.715160f * s.y + 0.072169f * s.z; }

inline bool is_black(const Spectrum& s) { return s.x == 0 && s.y == 0 && s.z == 0; }
inline bool is_finite(const Vec3f& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

inline float sqr(float x) { return x * x; }
inline float safe_sqrt(float x) { return std::sqrt(std::fmax(x, 0.0f)); }

/// Point on a ray; also usable for whole parametric lines.
struct Ray {
  Vec3f origin{0};
  Vec3f direction{0, 0, 1};  ///< unit length
  float max_distance = infinity;

  Vec3f at(float distance) const { return origin + distance * direction; }
};

}  // namespace fogbank
