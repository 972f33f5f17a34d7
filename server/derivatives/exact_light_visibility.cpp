#include "derivatives/exact_light_visibility.h"

#include <algorithm>
#include <array>
#include <numbers>
#include <queue>
#include <vector>

#include "derivatives/sightlines.h"

namespace fogbank::derivatives {

namespace {

/// Nodes and weights of the 15-point Kronrod rule and the 7-point Gauss rule within it, for [-1, 1]
/// (Piessens et al. 1983, "QUADPACK").
constexpr std::array<double, 8> nodes{
    0.991455371120812639, 0.949107912342758525, 0.864864423359769073, 0.741531185599394440,
    0.586087235467691130, 0.405845151377397167, 0.207784955007898468, 0.0};
constexpr std::array<double, 8> kronrod{0.022935322010529225, 0.063092092629978553, 0.104790010322250184,
                                        0.140653259715525919, 0.169004726639267903, 0.190350578064785410,
                                        0.204432940075298892, 0.209482141084727828};
constexpr std::array<double, 8> gauss{0, 0.129484966168869693, 0, 0.279705391489276668,
                                      0, 0.381830050505118945, 0, 0.417959183673469388};
/// Halvings of the step between two places: single-precision rays don't tell more apart.
constexpr int bisections = 20;
/// Pieces subtend about this angle or less (rad); the integrand is smooth over such.
constexpr double piece_angle = 0.5;
constexpr int32_t most_pieces = 64;

/// As many are spent on looking for a gap between two blockers.
constexpr int gap_bisections = 8;
/// Shadow rays stop short of the light by this share of their length, as World::visibility does.
constexpr double shadow_share = 1.0 - 1e-4;
/// More surfaces than this along one ray count as opaque: a guard against surfaces that coincide.
constexpr int most_passed_surfaces = 256;

/// What is before a point of the light, if not a shape.
constexpr int64_t visible = -1;
constexpr int64_t faces_away = -2;

struct Quadrature {
  Vec3d integral{0};
  double error = 0;
};

/// Integral over [a, b]; the error is the difference of the two rules, the largest of the channels.
template <typename Function>
Quadrature integrate(const Function& function, double a, double b) {
  const double middle = 0.5 * (a + b);
  const double half = 0.5 * (b - a);
  Vec3d fine(0);
  Vec3d coarse(0);
  for (size_t i = 0; i < nodes.size(); ++i) {
    const Vec3d value = nodes[i] == 0
                            ? function(middle)
                            : function(middle - half * nodes[i]) + function(middle + half * nodes[i]);
    fine += kronrod[i] * value;
    coarse += gauss[i] * value;
  }
  const Vec3d difference = glm::abs(fine - coarse) * half;
  return {fine * half, std::max({difference.x, difference.y, difference.z})};
}

class VisibleLight {
 public:
  VisibleLight(const transport::World& world, const transport::Plan& plan, uint32_t light, const Vec3d& x,
               int32_t medium, const LightPatch& patch, const VisibilityPrecision& precision,
               RayCounters& counters)
      : world_(world),
        x_(x),
        medium_(medium),
        patch_(patch),
        precision_(precision),
        counters_(counters),
        may_be_occluded_(plan.may_be_occluded(light, Vec3f(x))),
        may_cross_(plan.may_cross_boundaries(light, Vec3f(x))) {
    const double distance = glm::length(patch.at(0.5, 0.5).position - x);
    const auto pieces = [distance](double size) {
      return std::clamp(static_cast<int32_t>(std::ceil(size / (piece_angle * distance))), 1, most_pieces);
    };
    pieces_ = pieces(patch.length);
    panels_ = std::max(pieces(patch.width), may_be_occluded_ ? 4 : 1);
  }

  /// Worst panel first; they are added in the order of v, so that the sum doesn't depend on their history.
  Vec3d integrate_lines() const {
    struct Panel {
      double begin, end;
      Quadrature quadrature;
      bool operator<(const Panel& other) const { return quadrature.error < other.quadrature.error; }
    };
    const auto line = [this](double v) { return integrate_line(v); };
    std::priority_queue<Panel> panels;
    Vec3d sum(0);
    double error = 0;
    int32_t lines = 0;
    const auto push = [&](double begin, double end) {
      Quadrature quadrature = integrate(line, begin, end);
      if (may_be_occluded_) quadrature.error += end_error(begin, end) + end_error(end, begin);
      sum += quadrature.integral;
      error += quadrature.error;
      lines += 21;
      panels.push({begin, end, quadrature});
    };
    for (int32_t i = 0; i < panels_; ++i)
      push(static_cast<double>(i) / panels_, static_cast<double>(i + 1) / panels_);
    while (error > precision_.tolerance * std::max({sum.x, sum.y, sum.z}) && lines < precision_.most_lines) {
      const Panel worst = panels.top();
      panels.pop();
      sum -= worst.quadrature.integral;
      error -= worst.quadrature.error;
      const double middle = 0.5 * (worst.begin + worst.end);
      push(worst.begin, middle);
      push(middle, worst.end);
    }
    std::vector<Panel> all;
    for (; !panels.empty(); panels.pop()) all.push_back(panels.top());
    std::sort(all.begin(), all.end(), [](const Panel& a, const Panel& b) { return a.begin < b.begin; });
    Vec3d total(0);
    for (const Panel& panel : all) total += panel.quadrature.integral;
    return total;
  }

 private:
  /// What a jump between the end of a panel and its first node would contribute; the rules don't see it. A
  /// silhouette along the scan lines is such a jump. Smooth functions continue the line through two nodes.
  double end_error(double end, double other_end) const {
    const double half = 0.5 * (other_end - end);
    const double first = half * (1 - nodes[0]);
    const double second = half * (1 - nodes[1]);
    const Vec3d at_first = integrate_line(end + first);
    const Vec3d slope = (integrate_line(end + second) - at_first) / (second - first);
    const Vec3d jump = glm::abs(integrate_line(end) - (at_first - slope * first)) * std::fabs(first);
    return std::max({jump.x, jump.y, jump.z});
  }

  /// Sum over the visible pieces of the line.
  Vec3d integrate_line(double v) const {
    const auto value = [this, v](double u) { return integrand(u, v); };
    Vec3d sum(0);
    const auto add = [&](double begin, double end) {
      const int32_t count = std::max(1, static_cast<int32_t>(std::ceil((end - begin) * pieces_)));
      for (int32_t i = 0; i < count; ++i)
        sum += integrate(value, begin + (end - begin) * i / count, begin + (end - begin) * (i + 1) / count)
                   .integral;
    };
    if (!may_be_occluded_) {
      add(0, 1);
      return sum;
    }
    std::vector<double> changes;
    int64_t last = blocker(0, v);
    bool is_visible = last == visible;
    for (int32_t i = 1; i <= precision_.places; ++i) {
      const double u = static_cast<double>(i) / precision_.places;
      const int64_t next = blocker(u, v);
      find_changes(static_cast<double>(i - 1) / precision_.places, last, u, next, v, bisections, changes);
      last = next;
    }
    double begin = 0;
    for (const double change : changes) {
      if (is_visible) add(begin, change);
      begin = change;
      is_visible = !is_visible;
    }
    if (is_visible) add(begin, 1);
    return sum;
  }

  /// Appends where visibility changes between two places. Where one blocker takes over from another, there
  /// may be a gap between them that no place fell into.
  void find_changes(double u0, int64_t blocker0, double u1, int64_t blocker1, double v, int depth,
                    std::vector<double>& changes) const {
    if (blocker0 == blocker1) return;
    const bool same = (blocker0 == visible) == (blocker1 == visible);
    if (depth == 0 || (same && depth <= bisections - gap_bisections)) {
      if (!same) changes.push_back(0.5 * (u0 + u1));
      return;
    }
    const double middle = 0.5 * (u0 + u1);
    const int64_t between = blocker(middle, v);
    find_changes(u0, blocker0, middle, between, v, depth - 1, changes);
    find_changes(middle, between, u1, blocker1, v, depth - 1, changes);
  }

  /// The first opaque shape before a point of the light; `visible` when there is none, `faces_away` where the
  /// light itself turns its back.
  int64_t blocker(double u, double v) const {
    const LightPoint point = patch_.at(u, v);
    const Vec3d r = point.position - x_;
    const double distance = glm::length(r);
    if (!(glm::dot(r, point.normal) < 0)) return faces_away;
    const scene::Scene& scene = world_.scene();
    Ray ray{Vec3f(x_), Vec3f(r / distance), static_cast<float>(distance * shadow_share)};
    for (int passed = 0; passed < most_passed_surfaces; ++passed) {
      scene::Hit hit;
      ++counters_.closest_hit;
      if (!scene.intersector->intersect(ray, hit)) return visible;
      if (!scene.shapes[hit.shape].passes_light) return hit.shape;
      const scene::SurfaceInteraction surface = scene.interaction(ray, hit);
      const transport::ShadingPoint at = transport::World::shading_point(surface);
      if (is_black(world_.bsdf(hit.shape).null_transmission(at, at.frame.to_local(-ray.direction))))
        return hit.shape;
      ray.origin = surface.spawn_origin(ray.direction);
      ray.max_distance -= hit.distance;
      if (!(ray.max_distance > 0)) return visible;
    }
    return faces_away;
  }

  /// L T cos / (4 pi l^2) per du dv, whatever may be in between. Null where x is on the light.
  Vec3d integrand(double u, double v) const {
    const LightPoint point = patch_.at(u, v);
    const Vec3d r = point.position - x_;
    const double squared = glm::dot(r, r);
    const double distance = std::sqrt(squared);
    const double cosine = -glm::dot(r, point.normal);
    if (!(cosine > 0)) return Vec3d(0);
    const double kernel = std::numbers::inv_pi / 4 * point.area * cosine / (squared * distance);
    Vec3d value = Vec3d(point.radiance) * kernel;
    if (may_cross_) {
      Sightlines lines(world_);
      lines.start(Vec3f(x_), medium_);
      lines.append_to_points({&r, 1}, counters_);
      const RadianceJet transmittance = lines.path(0).towards(r);
      for (int c = 0; c < 3; ++c) value[c] *= transmittance.channels[static_cast<size_t>(c)].value;
    } else if (medium_ != scene::none) {
      for (int c = 0; c < 3; ++c)
        value[c] *= std::exp(-static_cast<double>(world_.medium(medium_).sigma_t[c]) * distance);
    }
    return value;
  }

  const transport::World& world_;
  Vec3d x_;
  int32_t medium_;
  const LightPatch& patch_;
  VisibilityPrecision precision_;
  RayCounters& counters_;
  bool may_be_occluded_;
  bool may_cross_;
  int32_t pieces_ = 1;
  int32_t panels_ = 1;
};

}  // namespace

Vec3d exact_direct_light(const transport::World& world, const transport::Plan& plan, uint32_t light,
                         const Vec3d& x, int32_t medium, const VisibilityPrecision& precision,
                         RayCounters& counters) {
  counters.poll();
  const std::optional<LightPatch> patch = light_patch(world.lights().light(light).shape(), x);
  if (!patch) return Vec3d(0);
  return VisibleLight(world, plan, light, x, medium, *patch, precision, counters).integrate_lines();
}

}  // namespace fogbank::derivatives
