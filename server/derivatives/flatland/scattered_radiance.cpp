#include "derivatives/flatland/scattered_radiance.h"

#include <algorithm>
#include <numbers>
#include <string>

#include "core/error.h"
#include "derivatives/flatland/field_functions.h"
#include "derivatives/flatland/quadrature.h"
#include "derivatives/scaled_vector.h"
#include "derivatives/transmittance_jet.h"

namespace fogbank::derivatives::flatland {

namespace {

/// Nodes a cell, in angle and along the ray. With 32 of them the double scattering of the box scene changes
/// by 3e-5 of its value at most, by 5e-5 of its Hessian at the median point and by 5e-3 at most.
constexpr int nodes_per_cell = 8;
/// Wider cells, in radians, are divided: the distance of a wall is 1 / cos.
constexpr double widest_cell = 0.6;
/// Optically deeper cells are divided along the ray.
constexpr double deepest_cell = 2;
/// Cells narrower than this, in radians, hold nothing.
constexpr double narrowest_cell = 1e-12;

std::vector<Vec2d> find_events(const Scene& scene, const std::vector<Line>& creases) {
  const Vec2d low = scene.box_min();
  const Vec2d high = scene.box_max();
  std::vector<Vec2d> events = scene.vertices();
  const double tolerance = 1e-12 * scene.diagonal();
  const auto add = [&](const Vec2d& point) {
    if (glm::any(glm::lessThan(point, low - tolerance)) ||
        glm::any(glm::greaterThan(point, high + tolerance)))
      return;
    const auto same = [&](const Vec2d& other) { return glm::distance(point, other) <= tolerance; };
    if (std::none_of(events.begin(), events.end(), same)) events.push_back(point);
  };
  for (const Vec2d& corner : {low, Vec2d(high.x, low.y), high, Vec2d(low.x, high.y)}) add(corner);
  const int surfaces = static_cast<int>(scene.segments().size()) + 4;
  std::vector<Line> lines = creases;
  for (int surface = 0; surface < surfaces; ++surface) lines.push_back(scene.line(surface));
  for (size_t i = 0; i < creases.size(); ++i) {
    for (size_t j = i + 1; j < lines.size(); ++j) {
      const double determinant = cross(lines[i].normal, lines[j].normal);
      if (std::abs(determinant) < 1e-12) continue;
      add(Vec2d(lines[i].offset * lines[j].normal.y - lines[j].offset * lines[i].normal.y,
                lines[j].offset * lines[i].normal.x - lines[i].offset * lines[j].normal.x) /
          determinant);
    }
  }
  return events;
}

}  // namespace

/// The integral at one point.
class ScatteredRadiance::View {
 public:
  View(const ScatteredRadiance& reference, const Vec2d& x)
      : scene_(reference.scene_),
        source_(reference.source_),
        creases_(reference.creases_),
        x_(x),
        position_{Jet2d::linear(x.x, {1, 0}), Jet2d::linear(x.y, {0, 1})} {
    std::vector<Jet2d> angles;
    for (const Vec2d& event : reference.events_) {
      const Vec2d r = event - x;
      const double distance = glm::length(r);
      if (distance <= 1e-12 * scene_.diagonal()) continue;
      if (scene_.trace(x, r / distance).distance < distance * (1 - 1e-9)) continue;
      angles.push_back(angle(Jet2d::linear(r.y, {0, -1}), Jet2d::linear(r.x, {-1, 0})));
    }
    std::sort(angles.begin(), angles.end(), [](const Jet2d& a, const Jet2d& b) { return a.value < b.value; });
    angles.push_back(angles.front() + Jet2d::constant(2 * std::numbers::pi));
    for (size_t i = 0; i + 1 < angles.size(); ++i) add_cell(angles[i], angles[i + 1]);
    sum_ *= scene_.sigma_s() / (2 * std::numbers::pi);
  }
  const Jet2d& result() const { return sum_; }

 private:
  void add_cell(const Jet2d& from, const Jet2d& to) {
    const Jet2d width = to - from;
    if (width.value < narrowest_cell) return;
    const double middle = from.value + width.value / 2;
    const int surface = scene_.trace(x_, {std::cos(middle), std::sin(middle)}).surface;
    const auto& rule = GaussLegendre<nodes_per_cell>::rule();
    const int parts = static_cast<int>(std::ceil(width.value / widest_cell));
    for (int part = 0; part < parts; ++part) {
      for (size_t i = 0; i < nodes_per_cell; ++i)
        add_ray(from + width * ((part + rule.nodes[i]) / parts), width * (rule.weights[i] / parts), surface);
    }
  }

  void add_ray(const Jet2d& theta, const Jet2d& weight, int surface) {
    direction_[0] = cosine(theta);
    direction_[1] = sine(theta);
    limits_.assign(1, Jet2d{});
    const Jet2d end = distance_to(scene_.line(surface));
    for (const Line& crease : creases_) {
      const Vec2d direction(direction_[0].value, direction_[1].value);
      const double distance =
          (crease.offset - glm::dot(crease.normal, x_)) / glm::dot(crease.normal, direction);
      if (distance > 0 && distance < end.value) limits_.push_back(distance_to(crease));
    }
    limits_.push_back(end);
    std::sort(limits_.begin(), limits_.end(),
              [](const Jet2d& a, const Jet2d& b) { return a.value < b.value; });
    for (size_t i = 0; i + 1 < limits_.size(); ++i)
      sum_ += weight * piece(limits_[i], limits_[i + 1] - limits_[i]);
  }

  /// int of T q ds over a length of the present ray.
  Jet2d piece(const Jet2d& from, const Jet2d& whole_length) const {
    const double sigma_t = scene_.sigma_t();
    if (sigma_t * from.value > greatest_depth) return {};
    const bool too_deep = sigma_t * whole_length.value > greatest_depth;
    const Jet2d length = too_deep ? Jet2d::constant(greatest_depth / sigma_t) : whole_length;
    const auto& rule = GaussLegendre<nodes_per_cell>::rule();
    const int parts = std::max(1, static_cast<int>(std::ceil(sigma_t * length.value / deepest_cell)));
    Jet2d sum;
    for (int part = 0; part < parts; ++part) {
      for (size_t i = 0; i < nodes_per_cell; ++i) {
        const Jet2d s = from + length * ((part + rule.nodes[i]) / parts);
        const Jet2d y[2] = {position_[0] + direction_[0] * s, position_[1] + direction_[1] * s};
        const Jet2d q = compose(source_.jet({y[0].value, y[1].value}), y[0], y[1]);
        sum += transmittance_jet(sigma_t, s) * q * (rule.weights[i] / parts);
      }
    }
    return sum * length;
  }

  Jet2d distance_to(const Line& line) const {
    const Jet2d gap = Jet2d::linear(line.offset - glm::dot(line.normal, x_), -line.normal);
    return gap * reciprocal(direction_[0] * line.normal.x + direction_[1] * line.normal.y);
  }

  const Scene& scene_;
  const Source& source_;
  const std::vector<Line>& creases_;
  Vec2d x_;
  Jet2d position_[2];
  Jet2d direction_[2];
  std::vector<Jet2d> limits_;
  Jet2d sum_;
};

ScatteredRadiance::ScatteredRadiance(const Scene& scene, const Source& source)
    : scene_(scene), source_(source), creases_(source.creases()) {
  if (creases_.size() > largest_crease_count) {
    throw Error(ErrorKind::resource_exhausted, "TOO_MANY_CREASES",
                "visibility changes on " + std::to_string(creases_.size()) +
                    " lines; the exact answer for multiple scattering takes at most " +
                    std::to_string(largest_crease_count) + " (4 segments)");
  }
  events_ = find_events(scene, creases_);
}

Jet2d ScatteredRadiance::at(const Vec2d& x) const { return View(*this, x).result(); }

}  // namespace fogbank::derivatives::flatland
