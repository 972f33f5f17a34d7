#include "derivatives/flatland/scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "core/error.h"
#include "derivatives/scaled_vector.h"

namespace fogbank::derivatives::flatland {

namespace {

constexpr double no_hit = std::numeric_limits<double>::infinity();

[[noreturn]] void refuse(const std::string& field, const std::string& problem) {
  throw Error(ErrorKind::invalid_argument, "INVALID_SCENE", field + ": " + problem);
}

void check_number(double number, double least, double greatest, const std::string& field,
                  const char* expected) {
  if (!(number >= least && number <= greatest)) refuse(field, std::string("must be ") + expected);
}

void check_position(const Vec2d& position, const std::string& field) {
  for (int axis = 0; axis < 2; ++axis)
    check_number(position[axis], -largest_number, largest_number, field, "finite, at most 1e12 in size");
}

double distance_to_segment(const Segment& segment, const Vec2d& x) {
  const Vec2d along = segment.end - segment.start;
  const double place = glm::dot(x - segment.start, along) / glm::dot(along, along);
  return glm::distance(x, segment.start + std::clamp(place, 0.0, 1.0) * along);
}

}  // namespace

Line line_through(const Vec2d& a, const Vec2d& b) {
  const Vec2d along = glm::normalize(b - a);
  const Vec2d normal(-along.y, along.x);
  return {normal, glm::dot(normal, a)};
}

Scene::Scene(SceneDescription description) : description_(std::move(description)) {
  check_position(box_min(), "box_min");
  check_position(box_max(), "box_max");
  for (int axis = 0; axis < 2; ++axis) {
    if (!(box_max()[axis] - box_min()[axis] >= 1 / largest_number))
      refuse("box_max", "must be greater than box_min in both coordinates, by at least 1e-12");
  }
  check_number(sigma_t(), 0, largest_number, "sigma_t", "between 0 and 1e12");
  check_number(description_.albedo, 0, 1, "albedo", "between 0 and 1");
  diagonal_ = glm::distance(box_min(), box_max());
  if (segments().size() > largest_segment_count)
    refuse("segments", "are more than " + std::to_string(largest_segment_count));

  for (size_t i = 0; i < segments().size(); ++i) {
    const Segment& segment = segments()[i];
    const std::string field = "segments[" + std::to_string(i) + "]";
    for (const auto& [end, name] : {std::pair{segment.start, ".start"}, std::pair{segment.end, ".end"}}) {
      check_position(end, field + name);
      if (glm::any(glm::lessThan(end, box_min())) || glm::any(glm::greaterThan(end, box_max())))
        refuse(field + name, "lies outside of the box");
    }
    if (glm::distance(segment.start, segment.end) < smallest_clearance * diagonal_)
      refuse(field, "is shorter than 1e-9 of the box's diagonal");
    check_number(segment.radiance, 0, largest_number, field + ".radiance", "between 0 and 1e12");
    lines_.push_back(line_through(segment.start, segment.end));
    vertices_.push_back(segment.start);
    vertices_.push_back(segment.end);
  }
  lines_.push_back({Vec2d(1, 0), box_max().x});
  lines_.push_back({Vec2d(1, 0), box_min().x});
  lines_.push_back({Vec2d(0, 1), box_max().y});
  lines_.push_back({Vec2d(0, 1), box_min().y});

  for (size_t i = 0; i < segments().size(); ++i) {
    for (size_t j = i + 1; j < segments().size(); ++j) {
      const Segment& a = segments()[i];
      const Segment& b = segments()[j];
      const Vec2d along = a.end - a.start;
      const Vec2d other = b.end - b.start;
      const double denominator = cross(along, other);
      if (denominator == 0) continue;
      const double place = cross(b.start - a.start, other) / denominator;
      const double other_place = cross(b.start - a.start, along) / denominator;
      if (place >= 0 && place <= 1 && other_place >= 0 && other_place <= 1)
        vertices_.push_back(a.start + place * along);
    }
  }
}

double Scene::distance(int segment, const Vec2d& x, const Vec2d& direction) const {
  const Segment& s = segments()[static_cast<size_t>(segment)];
  const Vec2d along = s.end - s.start;
  const Vec2d to_start = s.start - x;
  const double denominator = cross(direction, along);
  if (denominator == 0) return no_hit;
  const double place = cross(to_start, direction) / denominator;
  const double found = cross(to_start, along) / denominator;
  return place >= 0 && place <= 1 && found > 0 ? found : no_hit;
}

Hit Scene::trace(const Vec2d& x, const Vec2d& direction) const {
  const int count = static_cast<int>(segments().size());
  Hit hit{no_hit, count};
  for (int axis = 0; axis < 2; ++axis) {
    if (direction[axis] == 0) continue;
    const bool upper = direction[axis] > 0;
    const double side = upper ? box_max()[axis] : box_min()[axis];
    const double found = std::max(0.0, (side - x[axis]) / direction[axis]);
    if (found < hit.distance) hit = {found, count + 2 * axis + (upper ? 0 : 1)};
  }
  // Segments that lie on a side of the box are in front of it.
  double nearest = hit.distance * (1 + 1e-12);
  for (int segment = 0; segment < count; ++segment) {
    const double found = distance(segment, x, direction);
    if (found <= nearest) {
      nearest = found;
      hit = {found, segment};
    }
  }
  return hit;
}

void Scene::check_point(const Vec2d& x) const {
  const auto fail = [](const char* problem) {
    throw Error(ErrorKind::invalid_argument, "INVALID_POINT", std::string("the point ") + problem);
  };
  const double clearance = smallest_clearance * diagonal_;
  for (int axis = 0; axis < 2; ++axis) {
    if (!(x[axis] >= box_min()[axis] + clearance && x[axis] <= box_max()[axis] - clearance))
      fail("lies outside of the box or on its sides");
  }
  for (const Segment& segment : segments()) {
    if (distance_to_segment(segment, x) < clearance) fail("lies on a segment");
  }
}

}  // namespace fogbank::derivatives::flatland
