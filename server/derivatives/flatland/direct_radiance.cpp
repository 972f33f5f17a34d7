#include "derivatives/flatland/direct_radiance.h"

#include <algorithm>
#include <numbers>

#include "derivatives/flatland/quadrature.h"

namespace fogbank::derivatives::flatland {

namespace {

constexpr double half_pi = std::numbers::pi / 2;

/// int of exp(-sigma_t h / cos phi) from `from` to `to`.
template <ScalarField Field>
class TransmittanceIntegral {
 public:
  TransmittanceIntegral(const Field& optical_height, const Field& from, const Field& to)
      : optical_height_(optical_height), from_(from), width_(to - from) {
    add(0, 1);
  }
  const Field& result() const { return sum_; }

 private:
  /// The share [begin, end] of the interval. The integrand is singular at +-pi/2: a piece must not be longer
  /// than twice its distance from there, for which 12 nodes give 4^-24, or half of it for 6 nodes.
  void add(double begin, double end) {
    const double low = value_of(from_) + begin * value_of(width_);
    const double high = value_of(from_) + end * value_of(width_);
    const double clearance = std::min(half_pi + low, half_pi - high);
    if (high - low > 2 * clearance && high - low > 1e-9) {
      const double middle = (begin + end) / 2;
      add(begin, middle);
      add(middle, end);
    } else if (high - low > clearance / 2) {
      add_nodes(GaussLegendre<12>::rule(), begin, end);
    } else {
      add_nodes(GaussLegendre<6>::rule(), begin, end);
    }
  }
  template <int Count>
  void add_nodes(const GaussLegendre<Count>& rule, double begin, double end) {
    for (size_t i = 0; i < Count; ++i) {
      const Field phi = from_ + width_ * (begin + (end - begin) * rule.nodes[i]);
      const Field transmittance = decay<Field>(optical_height_ * secant<Field>(phi));
      sum_ += width_ * transmittance * ((end - begin) * rule.weights[i]);
    }
  }

  Field optical_height_;
  Field from_;
  Field width_;
  Field sum_{};
};

/// One light in its own frame: angles from its normal.
template <ScalarField Field>
class LightView {
 public:
  LightView(const Scene& scene, int light, const Vec2d& x) : scene_(scene), light_(light), x_(x) {
    const Segment& segment = scene.segments()[static_cast<size_t>(light)];
    along_ = glm::normalize(segment.end - segment.start);
    normal_ = scene.line(light).normal;
    height_ = glm::dot(segment.start - x, normal_);
    if (height_ < 0) {
      normal_ = -normal_;
      height_ = -height_;
    }
  }

  Field radiance() const {
    const Segment& segment = scene_.segments()[static_cast<size_t>(light_)];
    // On the light's own line it is seen edge-on.
    if (height_ < 1e-14 * scene_.diagonal()) return {};
    const std::vector<Boundary> boundaries = find_boundaries(segment);
    const Field optical_height = linear_field<Field>(height_, -normal_) * scene_.sigma_t();
    Field sum{};
    size_t begin = 0;
    for (size_t i = 0; i + 1 < boundaries.size(); ++i) {
      if (!visible((boundaries[i].angle + boundaries[i + 1].angle) / 2)) {
        begin = i + 1;
      } else if (i + 2 == boundaries.size() ||
                 !visible((boundaries[i + 1].angle + boundaries[i + 2].angle) / 2)) {
        sum += TransmittanceIntegral<Field>(optical_height, angle_of(boundaries[begin].vertex),
                                            angle_of(boundaries[i + 1].vertex))
                   .result();
        begin = i + 1;
      }
    }
    return sum * (segment.radiance / (2 * std::numbers::pi));
  }

 private:
  struct Boundary {
    Vec2d vertex;
    double angle;
  };

  /// Ends of the light and what may hide a part of it, by angle.
  std::vector<Boundary> find_boundaries(const Segment& segment) const {
    std::vector<Boundary> found;
    found.reserve(scene_.vertices().size() + 2);
    const auto plain_angle = [this](const Vec2d& vertex) {
      return std::atan2(glm::dot(vertex - x_, along_), glm::dot(vertex - x_, normal_));
    };
    const double first = plain_angle(segment.start);
    const double last = plain_angle(segment.end);
    found.push_back({segment.start, first});
    for (const Vec2d& vertex : scene_.vertices()) {
      const double depth = glm::dot(vertex - x_, normal_);
      if (depth <= 0 || depth > height_ * (1 + 1e-9)) continue;
      const double place = plain_angle(vertex);
      if (place > first && place < last) found.push_back({vertex, place});
    }
    found.push_back({segment.end, last});
    std::sort(found.begin(), found.end(),
              [](const Boundary& a, const Boundary& b) { return a.angle < b.angle; });
    return found;
  }

  bool visible(double phi) const {
    const Vec2d direction = std::cos(phi) * normal_ + std::sin(phi) * along_;
    const double distance = height_ / std::cos(phi) * (1 - 1e-12);
    for (int segment = 0; segment < static_cast<int>(scene_.segments().size()); ++segment) {
      if (segment != light_ && scene_.distance(segment, x_, direction) < distance) return false;
    }
    return true;
  }

  Field angle_of(const Vec2d& vertex) const {
    return angle(linear_field<Field>(glm::dot(vertex - x_, along_), -along_),
                 linear_field<Field>(glm::dot(vertex - x_, normal_), -normal_));
  }

  const Scene& scene_;
  int light_;
  Vec2d x_;
  Vec2d along_{0};
  Vec2d normal_{0};
  double height_ = 0;
};

}  // namespace

template <ScalarField Field>
Field direct_radiance(const Scene& scene, const Vec2d& x) {
  Field sum{};
  for (int light = 0; light < static_cast<int>(scene.segments().size()); ++light) {
    if (scene.radiance(light) > 0) sum += LightView<Field>(scene, light, x).radiance();
  }
  return sum;
}

template double direct_radiance<double>(const Scene& scene, const Vec2d& x);
template Jet2d direct_radiance<Jet2d>(const Scene& scene, const Vec2d& x);

std::vector<Line> DirectRadianceSource::creases() const {
  const std::vector<Vec2d>& vertices = scene_.vertices();
  const double tolerance = 1e-12 * scene_.diagonal();
  std::vector<Line> lines;
  for (size_t i = 0; i < vertices.size(); ++i) {
    for (size_t j = i + 1; j < vertices.size(); ++j) {
      if (glm::distance(vertices[i], vertices[j]) <= tolerance) continue;
      const auto holds_both = [&](const Line& line) {
        return std::abs(glm::dot(line.normal, vertices[i]) - line.offset) <= tolerance &&
               std::abs(glm::dot(line.normal, vertices[j]) - line.offset) <= tolerance;
      };
      if (std::none_of(lines.begin(), lines.end(), holds_both))
        lines.push_back(line_through(vertices[i], vertices[j]));
    }
  }
  return lines;
}

}  // namespace fogbank::derivatives::flatland
