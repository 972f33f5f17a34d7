#include "derivatives/outlines.h"

#include <algorithm>
#include <cmath>

namespace fogbank::derivatives {

namespace {

/// Weights closer than this share of the larger one aren't worth a silhouette.
constexpr float least_difference = 0.01f;

/// Neighbouring ends this close to each other's tangent planes, as a share of the distance, are on one
/// surface.
constexpr float flatness = 0.02f;
/// A jump in depth by more than this factor is none of two surfaces that meet.
constexpr float greatest_step = 1.5f;

/// A ray's end and the tangent plane there, in as few bytes as the search for jumps needs.
struct alignas(32) End {
  Vec3f direction;
  float distance;
  Vec3f normal;
  float height;  ///< normal . (distance * direction)
};

End make_end(const Vec3f& direction, const RayEnd& end) {
  // Nothing is compared with what is not there.
  const float distance = std::isfinite(end.distance) ? end.distance : 0;
  return {direction, distance, end.normal, distance * glm::dot(end.normal, direction)};
}

/// How far an end lies behind (positive) or before another's tangent plane along its own line.
struct PlaneOffset {
  bool is_small = false;
  bool is_before = false;
};

/// Of the end `b` and the plane at `a`. Planes that the line doesn't meet count as infinitely far away.
inline PlaneOffset offset_from_plane(const End& a, const End& b) {
  const float cosine = glm::dot(a.normal, b.direction);
  // b.distance - a.height / cosine, times |cosine|.
  const float offset = std::copysign(1.0f, cosine) * (b.distance * cosine - a.height);
  const bool meets = a.height * cosine > 0;
  return {meets && std::fabs(offset) <= flatness * b.distance * std::fabs(cosine), !meets || offset < 0};
}

/// Do two neighbouring ends lie on surfaces that meet between them, or is there a jump in depth?
inline bool surfaces_meet(const End& a, const End& b) {
  if (a.distance == 0 || b.distance == 0) return a.distance == b.distance;
  const PlaneOffset of_b = offset_from_plane(a, b);
  const PlaneOffset of_a = offset_from_plane(b, a);
  // At an edge or in a corner both ends lie on the same side of the other's tangent plane; across a jump the
  // far one lies behind the near one's and the near one before the far one's.
  const bool same_side = of_a.is_before == of_b.is_before &&
                         std::max(a.distance, b.distance) <= greatest_step * std::min(a.distance, b.distance);
  return (of_a.is_small && of_b.is_small) || same_side;
}

struct Jump {
  uint32_t edge = 0;
  float motion = 0;  ///< how much light it moves
};

/// An edge on its way to its outline: directions closing in on it from both sides.
struct Search {
  Vec3f near_direction{0};
  Vec3f far_direction{0};
  float near_distance = 0;
  float far_distance = 0;
};

bool same_surface(const Sightlines& a, size_t line_a, const Sightlines& b, size_t line_b) {
  if (!a.is_blocked(line_a) || !b.is_blocked(line_b)) return a.is_blocked(line_a) == b.is_blocked(line_b);
  return a.hit(line_a).shape == b.hit(line_b).shape && a.hit(line_a).instance == b.hit(line_b).instance;
}

/// Does a line between the two ends of an edge end on the near one's side of the outline?
bool is_near_side(const Sightlines& probes, size_t probe, const Sightlines& lines, const Outline& outline,
                  const Search& search) {
  const bool like_near = same_surface(probes, probe, lines, outline.near);
  const bool like_far = same_surface(probes, probe, lines, outline.far);
  if (like_near != like_far) return like_near;
  // One surface in front of itself, or a third one in between: the nearer in ratio of depths.
  const float distance = probes.distance(probe);
  if (!std::isfinite(distance)) return false;
  if (!std::isfinite(search.far_distance)) return true;
  return distance * distance < search.near_distance * search.far_distance;
}

}  // namespace

Outlines find_outlines(const Sightlines& lines, std::span<const RayEnd> ray_ends,
                       std::span<const DirectionTopology::Edge> edges, std::span<const float> weights,
                       int32_t steps, size_t most, RayCounters& counters) {
  Outlines outlines;
  outlines.of_edge.assign(edges.size(), Outlines::none);
  std::vector<End> ends;
  ends.reserve(ray_ends.size());
  bool mirrors = false;
  for (size_t i = 0; i < ray_ends.size(); ++i) {
    counters.poll_at(i);
    ends.push_back(make_end(lines.direction(i), ray_ends[i]));
    mirrors = mirrors || ray_ends[i].is_mirrored;
  }
  const auto is_mirrored = [&](uint32_t ray) { return mirrors && ray_ends[ray].is_mirrored; };
  std::vector<Jump> jumps;
  for (uint32_t e = 0; e < edges.size(); ++e) {
    counters.poll_at(e);
    const uint32_t a = edges[e].a;
    const uint32_t b = edges[e].b;
    if (surfaces_meet(ends[a], ends[b]) && is_mirrored(a) == is_mirrored(b)) continue;
    outlines.of_edge[e] = Outlines::unknown;
    if (is_mirrored(a) || is_mirrored(b)) continue;
    const float difference = std::fabs(weights[a] - weights[b]);
    if (!(difference > least_difference * std::max(weights[a], weights[b]))) continue;
    jumps.push_back({e, difference * std::fabs(1 / ray_ends[a].distance - 1 / ray_ends[b].distance)});
  }
  if (steps == 0 || most == 0) return outlines;
  if (jumps.size() > most) {
    std::nth_element(jumps.begin(), jumps.begin() + static_cast<std::ptrdiff_t>(most), jumps.end(),
                     [](const Jump& i, const Jump& j) {
                       return i.motion != j.motion ? i.motion > j.motion : i.edge < j.edge;
                     });
    jumps.resize(most);
    // Back in the order of the grid, in which neighbours are close.
    std::sort(jumps.begin(), jumps.end(), [](const Jump& i, const Jump& j) { return i.edge < j.edge; });
  }
  std::vector<Search> searches;
  for (const Jump& jump : jumps) {
    const DirectionTopology::Edge& edge = edges[jump.edge];
    outlines.of_edge[jump.edge] = static_cast<uint32_t>(outlines.points.size());
    Outline outline{edge.a, edge.b};
    if (ray_ends[edge.b].distance < ray_ends[edge.a].distance) std::swap(outline.near, outline.far);
    outlines.points.push_back(outline);
    searches.push_back({lines.direction(outline.near), lines.direction(outline.far),
                        ray_ends[outline.near].distance, ray_ends[outline.far].distance});
  }
  if (searches.empty()) return outlines;

  Sightlines probes(lines.world());
  std::vector<Vec3f> middles(searches.size());
  constexpr float anywhere = infinity;
  for (int32_t step = 0; step < steps; ++step) {
    for (size_t i = 0; i < searches.size(); ++i)
      middles[i] = glm::normalize(searches[i].near_direction + searches[i].far_direction);
    probes.start(lines.origin(), lines.medium());
    probes.append(middles, {&anywhere, 1}, counters);
    for (size_t i = 0; i < searches.size(); ++i) {
      counters.poll_at(i);
      Search& search = searches[i];
      if (is_near_side(probes, i, lines, outlines.points[i], search)) {
        search.near_direction = middles[i];
        search.near_distance = probes.distance(i);
      } else {
        search.far_direction = middles[i];
        search.far_distance = probes.distance(i);
      }
    }
  }
  for (size_t i = 0; i < searches.size(); ++i) {
    outlines.points[i].direction = searches[i].near_direction;
    outlines.points[i].near_distance = searches[i].near_distance;
    // A third surface may have come in between; the outline is the nearer side's.
    outlines.points[i].far_distance = std::max(searches[i].far_distance, searches[i].near_distance);
  }
  return outlines;
}

}  // namespace fogbank::derivatives
