#include "derivatives/light_grids/patch.h"

#include <numbers>

namespace fogbank::derivatives {

std::vector<Vec2d> patch_points(int32_t columns, int32_t rows, bool slide_border, RandomStream& random) {
  std::vector<Vec2d> points;
  points.reserve(static_cast<size_t>(columns + 1) * static_cast<size_t>(rows + 1));
  for (int32_t row = 0; row <= rows; ++row) {
    for (int32_t column = 0; column <= columns; ++column) {
      const bool inner_column = column > 0 && column < columns;
      const bool inner_row = row > 0 && row < rows;
      Vec2d offset(0);
      // Two numbers a vertex whether used or not, so that a vertex's jitter depends on its place alone.
      const Vec2f jitter = random.next_vec2();
      if (inner_column && (inner_row || slide_border)) offset.x = 0.7 * (static_cast<double>(jitter.x) - 0.5);
      if (inner_row && (inner_column || slide_border)) offset.y = 0.7 * (static_cast<double>(jitter.y) - 0.5);
      points.push_back({(column + offset.x) / columns, (row + offset.y) / rows});
    }
  }
  return points;
}

void append_patch_triangles(int32_t columns, int32_t rows, uint32_t first, bool mirrored, LightGrid& grid) {
  const auto vertex = [&](int32_t column, int32_t row) {
    return first + static_cast<uint32_t>(row * (columns + 1) + column);
  };
  const auto append = [&](uint32_t a, uint32_t b, uint32_t c) {
    grid.triangles.push_back({mirrored ? std::array{a, c, b} : std::array{a, b, c}, Spectrum(0)});
  };
  for (int32_t row = 0; row < rows; ++row) {
    for (int32_t column = 0; column < columns; ++column) {
      const uint32_t a = vertex(column, row);
      const uint32_t b = vertex(column + 1, row);
      const uint32_t c = vertex(column + 1, row + 1);
      const uint32_t d = vertex(column, row + 1);
      if ((row + column) % 2 == 0) {
        append(a, b, c);
        append(a, c, d);
      } else {
        append(a, b, d);
        append(b, c, d);
      }
    }
  }
}

Vec2d square_to_disk(const Vec2d& u) {
  const double a = 2 * u.x - 1;
  const double b = 2 * u.y - 1;
  if (a == 0 && b == 0) return {0, 0};
  constexpr double quarter = std::numbers::pi / 4;
  const bool wide = std::fabs(a) > std::fabs(b);
  const double radius = wide ? a : b;
  const double angle = wide ? quarter * (b / a) : 2 * quarter - quarter * (a / b);
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

double disk_border_radius(int32_t n) {
  const double step = std::numbers::pi / (2 * n);
  return std::sqrt(step / std::sin(step));
}

}  // namespace fogbank::derivatives
