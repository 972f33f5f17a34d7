#include "derivatives/hemisphere_rays.h"

#include <algorithm>
#include <cmath>

#include "core/frame.h"

namespace fogbank::derivatives {

HemisphereRays::HemisphereRays(const transport::World& world, const HemisphereGrid& grid,
                               const SurfaceSide& side, RandomStream& random, RayCounters& counters)
    : grid_(grid),
      side_(side),
      outward_(glm::dot(side.surface.geometric_normal, side.normal) < 0 ? -side.surface.geometric_normal
                                                                        : side.surface.geometric_normal),
      lines_(world) {
  Frame frame = Frame::from_normal(side.normal);
  // A random turn: neighbouring records see different rays.
  const float turn = 2 * pi * random.next_float();
  const Vec3f tangent = frame.tangent * std::cos(turn) + frame.bitangent * std::sin(turn);
  frame = {tangent, glm::cross(side.normal, tangent), side.normal};
  const uint32_t cells = grid.cell_count();
  std::vector<float> reach(cells, infinity);
  for (uint32_t v = 0; v < grid.vertex_count(); ++v) {
    const Vec2f u = v < cells ? random.next_vec2() : Vec2f(0);
    directions_.push_back(glm::normalize(frame.to_world(grid.direction(v, u))));
    if (v < cells && !leaves_outside(v)) reach[v] = 0;
  }
  lines_.start(side.surface.spawn_origin(outward_), side.medium);
  lines_.append(std::span(directions_).first(cells), reach, counters, &random);

  ends_.resize(grid.vertex_count());
  for (uint32_t cell = 0; cell < cells; ++cell) {
    counters.poll_at(cell);
    RayEnd& end = ends_[cell];
    const Vec3f& direction = directions_[cell];
    if (!leaves_outside(cell)) {
      // As the path tracer goes there, from the surface's other side; without parallax.
      Sightlines behind(world);
      constexpr float anywhere = infinity;
      behind.start(side.surface.spawn_origin(direction),
                   world.medium_beyond(side.surface, direction, side.medium));
      behind.append({&direction, 1}, {&anywhere, 1}, counters, &random);
      end.weight = behind.transmittance(0, behind.distance(0));
      if (behind.is_blocked(0)) add_hit(cell, behind.surface(0), behind.last_medium(0));
      continue;
    }
    end.distance = lines_.distance(cell);
    end.weight = lines_.transmittance(cell, end.distance);
    if (!lines_.is_blocked(cell)) continue;
    const scene::SurfaceInteraction surface = lines_.surface(cell);
    end.normal = surface.geometric_normal;
    end.surface = surface_number(lines_.hit(cell), surface.geometric_normal);
    add_hit(cell, surface, lines_.last_medium(cell));
  }
  for (auto v = static_cast<uint32_t>(cells); v < ends_.size(); ++v) {
    const uint32_t cell = grid.parent(v);
    ends_[v] = ends_[cell];
    if (!std::isfinite(ends_[cell].distance)) continue;
    const float height = ends_[cell].distance * glm::dot(ends_[cell].normal, directions_[cell]);
    const float cosine = glm::dot(ends_[cell].normal, directions_[v]);
    ends_[v].distance = height * cosine > 0 ? height / cosine : infinity;
  }
}

void HemisphereRays::add_hit(uint32_t cell, const scene::SurfaceInteraction& surface, int32_t medium) {
  hits_.push_back({surface, directions_[cell], medium, std::max(luminance(ends_[cell].weight), 0.0f)});
  cells_of_hits_.push_back(cell);
}

}  // namespace fogbank::derivatives
