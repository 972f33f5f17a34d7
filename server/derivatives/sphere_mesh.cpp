#include "derivatives/sphere_mesh.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

BatchVertex<float> make_vertex(const Vec3f& direction, float distance, float least_distance) {
  return {direction, 1 / std::max(distance, least_distance)};
}

/// Adds one triangle of the grid, in as many pieces as its outlines make of it.
class Splitter {
 public:
  Splitter(const JoinedEnds& grid, const Outlines& outlines, SphereMesh& mesh)
      : grid_(grid), outlines_(outlines), mesh_(mesh) {}

  void add(const DirectionTopology::Triangle& corners, const std::array<uint32_t, 3>& edges) {
    size_t cuts = 0;
    size_t last_cut = 0;
    size_t last_whole = 0;
    bool meets = true;
    for (size_t i = 0; i < 3; ++i) {
      const uint32_t outline = outlines_.of_edge[edges[i]];
      if (outline < Outlines::unknown) {
        ++cuts;
        last_cut = i;
      } else {
        last_whole = i;
        meets = meets && outline == Outlines::none;
      }
    }
    // With the corners numbered from the one where the cases below want to begin.
    const size_t first = cuts == 1 ? last_cut : cuts == 2 ? (last_whole + 2) % 3 : 0;
    const auto corner = [&](size_t i) { return corners[(first + i) % 3]; };
    const auto edge = [&](size_t i) { return edges[(first + i) % 3]; };
    const uint32_t a = corner(0);
    const uint32_t b = corner(1);
    const uint32_t c = corner(2);
    if (cuts == 0) {
      meets ? add_flat(a, b, c) : add_slanted(a, b, c);
    } else if (cuts == 1) {
      const Cut ab = cut(edge(0), a);
      is_whole(edge(2)) ? add_flat(a, ab.here, c) : add_slanted(a, ab.here, c);
      add_slanted(ab.here, ab.there, c);
      is_whole(edge(1)) ? add_flat(ab.there, b, c) : add_slanted(ab.there, b, c);
    } else if (cuts == 2) {
      const Cut ab = cut(edge(0), a);
      const Cut ac = cut(edge(2), a);
      add_flat(a, ab.here, ac.here);
      add_slanted(ab.here, ab.there, ac.there);
      add_slanted(ab.here, ac.there, ac.here);
      const bool whole = is_whole(edge(1));
      whole ? add_flat(ab.there, b, c) : add_slanted(ab.there, b, c);
      whole ? add_flat(ab.there, c, ac.there) : add_slanted(ab.there, c, ac.there);
    } else {
      const Cut ab = cut(edge(0), a);
      const Cut bc = cut(edge(1), b);
      const Cut ca = cut(edge(2), c);
      add_flat(a, ab.here, ca.there);
      add_flat(b, bc.here, ab.there);
      add_flat(c, ca.here, bc.there);
      add_slanted(ab.here, ab.there, bc.here);
      add_slanted(ab.here, bc.here, bc.there);
      add_slanted(ab.here, bc.there, ca.here);
      add_slanted(ab.here, ca.here, ca.there);
    }
  }

 private:
  /// The two vertices of an outline, ordered along an edge.
  struct Cut {
    uint32_t here = 0;  ///< on the surface of the corner that the edge is seen from
    uint32_t there = 0;
  };

  bool is_whole(uint32_t edge) const { return outlines_.of_edge[edge] == Outlines::none; }

  Cut cut(uint32_t edge, uint32_t from) const {
    const uint32_t index = outlines_.of_edge[edge];
    const auto near = static_cast<uint32_t>(grid_.ends.size() + 2 * index);
    return outlines_.points[index].near == from ? Cut{near, near + 1} : Cut{near + 1, near};
  }

  /// All corners on surfaces that meet: the mean rule.
  void add_flat(uint32_t a, uint32_t b, uint32_t c) {
    mesh_.triangles.push_back({{a, b, c}, BatchTriangle::all});
  }

  /// A jump in depth: the farthest rule. Corners about as far away as the farthest one share: on a strip
  /// along an outline both of its far ends.
  void add_slanted(uint32_t a, uint32_t b, uint32_t c) {
    const std::array<uint32_t, 3> corners{a, b, c};
    std::array<float, 3> closeness;
    for (size_t i = 0; i < 3; ++i) closeness[i] = mesh_.vertices[corners[i]].inverse_distance();
    const auto [farthest, nearest] = std::minmax_element(closeness.begin(), closeness.end());
    // The middle between near and far, as a ratio of distances.
    const float middle = std::sqrt(*farthest) * std::sqrt(*nearest);
    uint32_t receivers = 0;
    for (uint32_t i = 0; i < 3; ++i)
      if (closeness[i] <= middle) receivers |= 1u << i;
    mesh_.triangles.push_back({corners, receivers});
  }

  const JoinedEnds& grid_;
  const Outlines& outlines_;
  SphereMesh& mesh_;
};

}  // namespace

SphereMesh make_sphere_mesh(const JoinedEnds& grid, const Outlines& outlines, std::span<const uint8_t> lit,
                            float least_distance, const RayCounters& counters) {
  SphereMesh mesh;
  const size_t count = grid.ends.size() + 2 * outlines.points.size();
  mesh.vertices.reserve(count);
  mesh.rays.reserve(count);
  for (uint32_t ray = 0; ray < grid.ends.size(); ++ray) {
    counters.poll_at(ray);
    mesh.vertices.push_back(make_vertex(grid.directions[ray], grid.ends[ray].distance, least_distance));
    mesh.rays.push_back(ray);
  }
  for (const Outline& outline : outlines.points) {
    mesh.vertices.push_back(make_vertex(outline.direction, outline.near_distance, least_distance));
    mesh.vertices.push_back(make_vertex(outline.direction, outline.far_distance, least_distance));
    mesh.rays.push_back(outline.near);
    mesh.rays.push_back(outline.far);
  }
  const auto triangles = grid.triangles;
  mesh.triangles.reserve(triangles.size() + 8 * outlines.points.size());
  Splitter splitter(grid, outlines, mesh);
  for (size_t t = 0; t < triangles.size(); ++t) {
    counters.poll_at(t);
    const auto& [a, b, c] = triangles[t];
    if ((lit[a] | lit[b] | lit[c]) != 0) splitter.add(triangles[t], grid.triangle_edges[t]);
  }
  return mesh;
}

}  // namespace fogbank::derivatives
