#include "derivatives/light_grids/refinement.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <numbers>
#include <queue>

namespace fogbank::derivatives {

Refinement::Refinement(std::vector<Vec3d> vertices, std::vector<Triangle> triangles, bool on_sphere)
    : vertices_(std::move(vertices)), triangles_(std::move(triangles)), on_sphere_(on_sphere) {
  for (uint32_t t = 0; t < triangles_.size(); ++t) {
    const auto& v = triangles_[t].vertices;
    for (size_t e = 0; e < 3; ++e) of_edge_[key(v[e], v[(e + 1) % 3])].push_back(t);
  }
}

double Refinement::angle(uint32_t a, uint32_t b) const {
  const Vec3d& p = vertices_[a];
  const Vec3d& q = vertices_[b];
  return std::atan2(glm::length(glm::cross(p, q)), glm::dot(p, q));
}

size_t Refinement::longest_edge(const Triangle& triangle) const {
  const auto& v = triangle.vertices;
  size_t longest = 0;
  double longest_angle = angle(v[0], v[1]);
  for (size_t e = 1; e < 3; ++e) {
    const double this_angle = angle(v[e], v[(e + 1) % 3]);
    if (this_angle > longest_angle ||
        (this_angle == longest_angle && key(v[e], v[(e + 1) % 3]) < key(v[longest], v[(longest + 1) % 3]))) {
      longest = e;
      longest_angle = this_angle;
    }
  }
  return longest;
}

double Refinement::width(uint32_t triangle) const {
  const Triangle& t = triangles_[triangle];
  const size_t e = longest_edge(t);
  return angle(t.vertices[e], t.vertices[(e + 1) % 3]);
}

void Refinement::split_edge(uint32_t a, uint32_t b, double share, const OnSplit& on_split) {
  const auto middle = static_cast<uint32_t>(vertices_.size());
  if (a > b) std::swap(a, b);
  const Vec3d point = vertices_[a] + (vertices_[b] - vertices_[a]) * share;
  vertices_.push_back(on_sphere_ ? glm::normalize(point) : point);
  const std::vector<uint32_t> beside = std::move(of_edge_[key(a, b)]);
  of_edge_.erase(key(a, b));
  for (const uint32_t t : beside) {
    Triangle& first = triangles_[t];
    size_t e = 0;
    while (key(first.vertices[e], first.vertices[(e + 1) % 3]) != key(a, b)) ++e;
    const size_t next = (e + 1) % 3;
    const size_t opposite = (e + 2) % 3;
    const auto from_share = static_cast<float>(first.vertices[e] == a ? share : 1 - share);
    const Vec2f uv = first.uvs[e] + (first.uvs[next] - first.uvs[e]) * from_share;
    Triangle second = first;
    second.vertices[e] = middle;
    second.uvs[e] = uv;
    const uint32_t end = first.vertices[next];
    first.vertices[next] = middle;
    first.uvs[next] = uv;
    const auto appended = static_cast<uint32_t>(triangles_.size());
    const uint32_t from = first.vertices[e];
    const uint32_t apex = first.vertices[opposite];
    triangles_.push_back(second);  // `first` is no longer valid
    of_edge_[key(from, middle)].push_back(t);
    of_edge_[key(middle, end)].push_back(appended);
    of_edge_[key(middle, apex)] = {t, appended};
    std::vector<uint32_t>& moved = of_edge_[key(end, apex)];
    std::replace(moved.begin(), moved.end(), t, appended);
    changed_.push_back(t);
    changed_.push_back(appended);
    if (on_split) on_split(t, appended, middle, apex);
  }
}

void Refinement::refine(size_t triangles, const std::function<double(uint32_t)>& importance, double jitter,
                        RandomStream& random, const OnSplit& on_split) {
  struct Candidate {
    double importance;
    uint32_t triangle;
    std::array<uint32_t, 3> vertices;
    bool operator<(const Candidate& other) const {
      return importance != other.importance ? importance < other.importance : triangle > other.triangle;
    }
  };
  std::priority_queue<Candidate> queue;
  const auto push = [&](uint32_t t) {
    const double value = importance(t);
    if (value > 0) queue.push({value, t, triangles_[t].vertices});
  };
  for (uint32_t t = 0; t < triangles_.size(); ++t) push(t);
  while (triangles_.size() < triangles && !queue.empty()) {
    const Candidate candidate = queue.top();
    queue.pop();
    if (triangles_[candidate.triangle].vertices != candidate.vertices) continue;  // split meanwhile
    changed_.clear();
    // To the end of the path of longest edges: each step's edge is longer than the last one's.
    uint32_t t = candidate.triangle;
    uint64_t edge = 0;
    while (true) {
      const Triangle& triangle = triangles_[t];
      const size_t e = longest_edge(triangle);
      const uint64_t longest = key(triangle.vertices[e], triangle.vertices[(e + 1) % 3]);
      if (longest == edge) break;
      edge = longest;
      const std::vector<uint32_t>& beside = of_edge_.at(edge);
      if (beside.size() != 2) break;
      t = beside[0] == t ? beside[1] : beside[0];
    }
    const double share = 0.5 + jitter * (2 * static_cast<double>(random.next_float()) - 1);
    split_edge(static_cast<uint32_t>(edge >> 32), static_cast<uint32_t>(edge), share, on_split);
    for (const uint32_t changed : changed_) push(changed);
    if (triangles_[candidate.triangle].vertices == candidate.vertices) queue.push(candidate);
  }
}

DirectionMesh octahedron() {
  DirectionMesh mesh;
  mesh.directions = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  mesh.triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  return mesh;
}

DirectionMesh uniform_directions(size_t triangles) {
  DirectionMesh mesh = octahedron();
  std::vector<Refinement::Triangle> faces;
  for (const auto& vertices : mesh.triangles) faces.push_back({vertices, {}, 0});
  Refinement refinement(mesh.directions, faces, true);
  RandomStream unused(0, 0, 0, 0);
  refinement.refine(
      triangles, [&](uint32_t t) { return refinement.width(t); }, 0, unused);
  mesh.directions = refinement.vertices();
  mesh.triangles.clear();
  for (const Refinement::Triangle& triangle : refinement.triangles())
    mesh.triangles.push_back(triangle.vertices);
  return mesh;
}

glm::dmat3 random_rotation(RandomStream& random) {
  const double u = random.next_float();
  const double a = 2 * std::numbers::pi * random.next_float();
  const double b = 2 * std::numbers::pi * random.next_float();
  const glm::dquat q(std::sqrt(u) * std::cos(b), std::sqrt(1 - u) * std::sin(a),
                     std::sqrt(1 - u) * std::cos(a), std::sqrt(u) * std::sin(b));
  return glm::mat3_cast(q);
}

}  // namespace fogbank::derivatives
