#include <algorithm>
#include <cmath>
#include <numbers>

#include "derivatives/light_grids/kinds.h"
#include "derivatives/light_grids/patch.h"
#include "derivatives/light_grids/refinement.h"
#include "derivatives/triangle_form_factor.h"

namespace fogbank::derivatives {

namespace {

/// Blocks of the image's cells are averaged until there are no more than this.
constexpr int64_t most_cells = 1 << 21;
/// Share of the mean radiance that counts as everywhere, so that dark parts get cells too.
constexpr double floor_share = 0.1;
/// Triangles no wider than this, whatever their energy: the transmittance differs from direction to
/// direction.
constexpr double widest_cell = 0.4;

/// Triangles over fewer cells than this are smaller than what the image resolves: their energy is the
/// bilinear image's, by quadrature.
constexpr size_t fewest_cells = 16;

/// A block of the image.
struct Cell {
  Vec3d direction;
  Vec3d energy;  ///< radiance times solid angle
};

class GriddedImageEnvironment final : public GriddedLight {
 public:
  GriddedImageEnvironment(const transport::ImageShape& shape, const transport::Light& light, int32_t n) {
    const std::vector<Cell> cells = cells_of(shape, light);
    const DirectionMesh base = octahedron();
    std::vector<Refinement::Triangle> faces;
    for (const auto& vertices : base.triangles) faces.push_back({vertices, {}, 0});
    Refinement refinement(base.directions, faces, true);
    std::vector<std::vector<uint32_t>> inside(faces.size());
    for (uint32_t i = 0; i < cells.size(); ++i) {
      const Vec3d& d = cells[i].direction;
      const size_t quadrant = d.y >= 0 ? (d.x >= 0 ? 0 : 1) : (d.x >= 0 ? 3 : 2);
      inside[(d.z >= 0 ? 0 : 4) + quadrant].push_back(i);
    }
    const auto on_split = [&](uint32_t first, uint32_t second, uint32_t middle, uint32_t apex) {
      inside.resize(std::max<size_t>(inside.size(), second + 1));
      const auto& v = refinement.triangles()[first].vertices;
      const Vec3d plane = glm::cross(refinement.vertices()[middle], refinement.vertices()[apex]);
      Vec3d side(0);  // the corner of the first half that is on neither end of the cut
      for (const uint32_t corner : v) {
        if (corner != middle && corner != apex) side = refinement.vertices()[corner];
      }
      const double sign = glm::dot(plane, side) >= 0 ? 1 : -1;
      std::vector<uint32_t>& list = inside[first];
      const auto rest = std::stable_partition(list.begin(), list.end(), [&](uint32_t i) {
        return sign * glm::dot(plane, cells[i].direction) >= 0;
      });
      inside[second].assign(rest, list.end());
      list.erase(rest, list.end());
    };
    const double everywhere = floor_of(cells);
    const auto mean_of = [&](uint32_t t) {
      const auto& [a, b, c] = refinement.triangles()[t].vertices;
      return mean_radiance(refinement.vertices()[a], refinement.vertices()[b], refinement.vertices()[c],
                           cells, inside[t], light);
    };
    const auto importance = [&](uint32_t t) {
      const double width = refinement.width(t);
      if (width > widest_cell) return 1e300 * width;
      const auto& [a, b, c] = refinement.triangles()[t].vertices;
      return solid_angle(refinement.vertices()[a], refinement.vertices()[b], refinement.vertices()[c]) *
             (everywhere + static_cast<double>(luminance(mean_of(t))));
    };
    RandomStream unused(0, 0, 0, 0);
    refinement.refine(8 * static_cast<size_t>(n) * static_cast<size_t>(n), importance, 0, unused, on_split);

    grid_.at_infinity = true;
    grid_.vertices = refinement.vertices();
    for (uint32_t t = 0; t < refinement.triangles().size(); ++t)
      grid_.triangles.push_back({refinement.triangles()[t].vertices, mean_of(t)});
  }

  void cut(const Vec3d&, RandomStream&, LightGrid& grid) const override { grid = grid_; }

 private:
  static double solid_angle(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    return 4 * std::numbers::pi * triangle_form_factor(RelativeTriangle<double>::from_relative(a, b, c));
  }

  static Spectrum mean_radiance(const Vec3d& a, const Vec3d& b, const Vec3d& c,
                                const std::vector<Cell>& cells, const std::vector<uint32_t>& inside,
                                const transport::Light& light) {
    const double angle = solid_angle(a, b, c);
    if (inside.size() < fewest_cells || !(angle > 0))
      return mean_over_triangle(
          a, b, c, [&](const Vec3d& p) { return light.emitted(Vec3f(glm::normalize(p)), nullptr); });
    Vec3d energy(0);
    for (const uint32_t i : inside) energy += cells[i].energy;
    return Spectrum(energy / angle);
  }

  /// Radiance that counts as everywhere when cells are chosen.
  static double floor_of(const std::vector<Cell>& cells) {
    Vec3d total(0);
    for (const Cell& cell : cells) total += cell.energy;
    return floor_share * static_cast<double>(luminance(Spectrum(total))) / (4 * std::numbers::pi);
  }

  static std::vector<Cell> cells_of(const transport::ImageShape& shape, const transport::Light& light) {
    int32_t block = 1;
    while (static_cast<int64_t>(shape.columns / block) * (shape.rows / block) > most_cells) block *= 2;
    std::vector<Cell> cells;
    for (int32_t row = 0; row < shape.rows; row += block) {
      const int32_t rows = std::min(block, shape.rows - row);
      for (int32_t column = 0; column < shape.columns; column += block) {
        const int32_t columns = std::min(block, shape.columns - column);
        Cell cell{Vec3d(0), Vec3d(0)};
        for (int32_t j = row; j < row + rows; ++j) {
          const double top = std::numbers::pi * j / shape.rows;
          const double bottom = std::numbers::pi * (j + 1) / shape.rows;
          const double angle = 2 * std::numbers::pi / shape.columns * (std::cos(top) - std::cos(bottom));
          const double polar = 0.5 * (top + bottom);
          for (int32_t i = column; i < column + columns; ++i) {
            const double azimuth = 2 * std::numbers::pi * (i + 0.5) / shape.columns;
            const Vec3f local(Vec3d(std::sin(azimuth) * std::sin(polar), std::cos(polar),
                                    -std::cos(azimuth) * std::sin(polar)));
            const Vec3f direction = glm::normalize(shape.to_world * local);
            cell.direction += Vec3d(direction) * angle;
            cell.energy += Vec3d(light.emitted(direction, nullptr)) * angle;
          }
        }
        cell.direction = glm::normalize(cell.direction);
        cells.push_back(cell);
      }
    }
    return cells;
  }

  LightGrid grid_;
};

}  // namespace

GriddedLightPointer grid_image_environment(const transport::ImageShape& shape, const transport::Light& light,
                                           int32_t n) {
  return std::make_unique<GriddedImageEnvironment>(shape, light, n);
}

}  // namespace fogbank::derivatives
