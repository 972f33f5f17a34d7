#include <algorithm>
#include <array>
#include <map>

#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"
#include "derivatives/light_grids/refinement.h"

namespace fogbank::derivatives {

namespace {

class GriddedMesh final : public GriddedLight {
 public:
  GriddedMesh(const std::vector<transport::TriangleShape>& shapes, int32_t n) : n_(n) {
    // Readers give corners with a normal or uv of their own a vertex of their own: places are what counts
    // here.
    std::map<std::array<float, 3>, uint32_t> places;
    for (const transport::TriangleShape& shape : shapes) {
      Face face;
      face.radiance = shape.radiance;
      face.corners.uvs = shape.uvs;
      for (size_t i = 0; i < 3; ++i) {
        const Vec3f& p = shape.vertices[i];
        const auto [place, is_new] =
            places.try_emplace({p.x, p.y, p.z}, static_cast<uint32_t>(positions_.size()));
        if (is_new) positions_.push_back(Vec3d(p));
        face.corners.vertices[i] = place->second;
      }
      face.normal = glm::cross(Vec3d(shape.vertices[1]) - Vec3d(shape.vertices[0]),
                               Vec3d(shape.vertices[2]) - Vec3d(shape.vertices[0]));
      face.power = luminance(shape.radiance->mean());
      // Counter-clockwise seen from the emitting side is clockwise as directions from x go.
      std::swap(face.corners.vertices[1], face.corners.vertices[2]);
      std::swap(face.corners.uvs[1], face.corners.uvs[2]);
      faces_.push_back(face);
    }
  }

  void cut(const Vec3d& x, RandomStream& random, LightGrid& grid) const override {
    grid.clear();
    std::vector<Chosen> chosen;
    for (uint32_t i = 0; i < faces_.size(); ++i) {
      if (glm::dot(positions_[faces_[i].corners.vertices[0]] - x, faces_[i].normal) < 0)
        chosen.push_back({i, 1});
    }
    if (chosen.empty()) return;
    if (chosen.size() > most_mesh_triangles(n_)) chosen = sample(chosen, x, random, grid);

    std::vector<Vec3d> vertices;
    std::vector<Refinement::Triangle> triangles;
    std::vector<uint32_t> place(positions_.size(), unplaced);
    for (uint32_t i = 0; i < chosen.size(); ++i) {
      Refinement::Triangle triangle = faces_[chosen[i].face].corners;
      triangle.source = i;
      for (uint32_t& vertex : triangle.vertices) {
        if (place[vertex] == unplaced) {
          place[vertex] = static_cast<uint32_t>(vertices.size());
          vertices.push_back(positions_[vertex] - x);
        }
        vertex = place[vertex];
      }
      triangles.push_back(triangle);
    }
    const size_t enough = 2 * static_cast<size_t>(n_) * static_cast<size_t>(n_);
    if (triangles.size() >= enough) {
      fill(vertices, triangles, chosen, grid);
      return;
    }
    Refinement refinement(std::move(vertices), std::move(triangles), false);
    refinement.refine(
        enough, [&](uint32_t t) { return refinement.width(t); }, 0.15, random);
    fill(refinement.vertices(), refinement.triangles(), chosen, grid);
  }

 private:
  static constexpr uint32_t unplaced = 0xFFFFFFFFu;

  struct Face {
    Refinement::Triangle corners;
    Vec3d normal{0};  ///< on the emitting side, twice the area long
    const scene::Texture* radiance = nullptr;
    double power = 0;  ///< luminance of its radiance
  };
  struct Chosen {
    uint32_t face;
    double probability;
  };

  Spectrum radiance_of(const Refinement::Triangle& triangle, const scene::Texture& texture) const {
    if (texture.is_constant()) return texture.evaluate(Vec2f(0));
    return mean_over_triangle(triangle.uvs[0], triangle.uvs[1], triangle.uvs[2],
                              [&](const Vec2f& uv) { return texture.evaluate(uv); });
  }

  void fill(const std::vector<Vec3d>& vertices, const std::vector<Refinement::Triangle>& triangles,
            const std::vector<Chosen>& chosen, LightGrid& grid) const {
    grid.vertices = vertices;
    for (const Refinement::Triangle& triangle : triangles) {
      const Chosen& choice = chosen[triangle.source];
      grid.triangles.push_back({triangle.vertices, radiance_of(triangle, *faces_[choice.face].radiance) *
                                                       static_cast<float>(1 / choice.probability)});
    }
  }

  /// Systematic sampling over the faces in the mesh's order, which keeps neighbours apart. All faces that
  /// x could see get their unoccluded light, the chosen ones less what their grid will add too often.
  std::vector<Chosen> sample(const std::vector<Chosen>& facing, const Vec3d& x, RandomStream& random,
                             LightGrid& grid) const {
    std::vector<double> weights;
    double total = 0;
    for (const Chosen& choice : facing) {
      const Face& face = faces_[choice.face];
      const Vec3d r = positions_[face.corners.vertices[0]] - x;
      const double squared = std::max(glm::dot(r, r), 0.25 * glm::length(face.normal));
      weights.push_back(-glm::dot(r, face.normal) / (squared * std::sqrt(squared)) * face.power);
      total += weights.back();
    }
    if (!(total > 0)) return {};
    const double picks = 0.25 * static_cast<double>(most_mesh_triangles(n_));
    std::vector<Chosen> result;
    double next = random.next_float();
    double running = 0;
    for (size_t i = 0; i < facing.size(); ++i) {
      const Face& face = faces_[facing[i].face];
      const double expected = weights[i] / total * picks;
      const double probability = std::min(expected, 1.0);
      running += probability;
      double correction = 1;
      if (running > next) {
        next += 1;
        result.push_back({facing[i].face, probability});
        correction -= 1 / probability;
      }
      if (correction == 0) continue;
      const auto& corners = face.corners;
      grid.unoccluded.push_back({{positions_[corners.vertices[0]] - x, positions_[corners.vertices[1]] - x,
                                  positions_[corners.vertices[2]] - x},
                                 radiance_of(corners, *face.radiance) * static_cast<float>(correction)});
    }
    return result;
  }

  int32_t n_;
  std::vector<Vec3d> positions_;
  std::vector<Face> faces_;
};

}  // namespace

GriddedLightPointer grid_mesh(const std::vector<transport::TriangleShape>& triangles, int32_t n) {
  return std::make_unique<GriddedMesh>(triangles, n);
}

}  // namespace fogbank::derivatives
