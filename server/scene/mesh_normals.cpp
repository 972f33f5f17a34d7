#include "scene/mesh_normals.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <numeric>
#include <tuple>
#include <utility>

namespace fogbank::scene {

namespace {

/// Unit normals of the faces; zero for a face without area.
std::vector<Vec3d> face_normals(const Mesh& mesh) {
  std::vector<Vec3d> normals;
  normals.reserve(mesh.triangles.size());
  for (const Vec3u& t : mesh.triangles) {
    const Vec3d p0(mesh.positions[t.x]);
    const Vec3d n = glm::cross(Vec3d(mesh.positions[t.y]) - p0, Vec3d(mesh.positions[t.z]) - p0);
    const double length = glm::length(n);
    normals.push_back(length > 0 ? n / length : Vec3d(0));
  }
  return normals;
}

/// Interior angle of the triangle at its corner, in radians.
double corner_angle(const Mesh& mesh, const Vec3u& triangle, int corner) {
  const Vec3d p(mesh.positions[triangle[corner]]);
  const Vec3d a = Vec3d(mesh.positions[triangle[(corner + 1) % 3]]) - p;
  const Vec3d b = Vec3d(mesh.positions[triangle[(corner + 2) % 3]]) - p;
  return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b));
}

/// Above it a position keeps its faces' own normals: comparing all pairs would let a crafted file take hours.
constexpr size_t most_faces_at_a_position = 4096;

Vec3f unit_or(const Vec3d& v, const Vec3d& fallback) {
  const double length = glm::length(v);
  return Vec3f(length > 1e-12 ? v / length : fallback);
}

}  // namespace

void complete_vertex_normals(Mesh& mesh) {
  if (mesh.faceted) return;
  const std::vector<Vec3d> faces = face_normals(mesh);
  std::vector<Vec3d> sums(mesh.positions.size(), Vec3d(0));
  for (size_t i = 0; i < mesh.triangles.size(); ++i) {
    for (int corner = 0; corner < 3; ++corner)
      sums[mesh.triangles[i][corner]] += corner_angle(mesh, mesh.triangles[i], corner) * faces[i];
  }
  const bool all = mesh.normals.empty();
  mesh.normals.resize(mesh.positions.size(), Vec3f(0));
  for (size_t i = 0; i < sums.size(); ++i) {
    if (all || mesh.normals[i] == Vec3f(0)) mesh.normals[i] = unit_or(sums[i], {0, 0, 1});
  }
}

void smooth_up_to_angle(Mesh& mesh, double degrees) {
  const std::vector<Vec3d> faces = face_normals(mesh);
  const double least_cosine = std::cos(degrees * std::numbers::pi / 180.0);

  // Corners ordered by position, so that those which meet at a point are next to each other.
  std::vector<uint32_t> corners(3 * mesh.triangles.size());
  std::iota(corners.begin(), corners.end(), 0u);
  const auto vertex = [&](uint32_t corner) {
    return mesh.triangles[corner / 3][static_cast<int>(corner % 3)];
  };
  const auto key = [&](uint32_t corner) {
    const Vec3f& p = mesh.positions[vertex(corner)];
    return std::tuple(p.x, p.y, p.z, corner);
  };
  std::sort(corners.begin(), corners.end(), [&](uint32_t a, uint32_t b) { return key(a) < key(b); });

  std::vector<Vec3f> corner_normals(corners.size());
  for (size_t begin = 0; begin < corners.size();) {
    size_t end = begin + 1;
    while (end < corners.size() &&
           mesh.positions[vertex(corners[end])] == mesh.positions[vertex(corners[begin])])
      ++end;
    const bool smooth = end - begin <= most_faces_at_a_position;
    for (size_t i = begin; i < end; ++i) {
      const Vec3d& own = faces[corners[i] / 3];
      Vec3d sum(0);
      for (size_t j = begin; smooth && j < end; ++j) {
        const Vec3d& other = faces[corners[j] / 3];
        if (i == j || glm::dot(own, other) >= least_cosine)
          sum += corner_angle(mesh, mesh.triangles[corners[j] / 3], static_cast<int>(corners[j] % 3)) * other;
      }
      corner_normals[corners[i]] = unit_or(sum, own);
    }
    begin = end;
  }

  // Corners that agree on the old vertex and on the normal become one new vertex.
  std::sort(corners.begin(), corners.end(), [&](uint32_t a, uint32_t b) {
    const Vec3f& m = corner_normals[a];
    const Vec3f& n = corner_normals[b];
    return std::tuple(vertex(a), m.x, m.y, m.z, a) < std::tuple(vertex(b), n.x, n.y, n.z, b);
  });
  Mesh split;
  split.dropped_triangles = mesh.dropped_triangles;
  split.triangles.resize(mesh.triangles.size());
  for (size_t i = 0; i < corners.size(); ++i) {
    const uint32_t corner = corners[i];
    const bool is_new = i == 0 || vertex(corner) != vertex(corners[i - 1]) ||
                        corner_normals[corner] != corner_normals[corners[i - 1]];
    if (is_new) {
      split.positions.push_back(mesh.positions[vertex(corner)]);
      split.normals.push_back(corner_normals[corner]);
      if (!mesh.uvs.empty()) split.uvs.push_back(mesh.uvs[vertex(corner)]);
    }
    split.triangles[corner / 3][static_cast<int>(corner % 3)] =
        static_cast<uint32_t>(split.positions.size() - 1);
  }
  mesh = std::move(split);
}

}  // namespace fogbank::scene
