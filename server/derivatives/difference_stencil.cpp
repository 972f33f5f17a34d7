#include "derivatives/difference_stencil.h"

#include <algorithm>
#include <cmath>

#include "core/frame.h"
#include "core/sampling.h"

namespace fogbank::derivatives {

namespace {

using Mat3d = glm::dmat3;
using Axes = std::array<Vec3d, 3>;

/// Nine derivatives of one channel.
struct Derivatives {
  Vec3d gradient{0};
  Symmetric3d hessian;

  Derivatives& operator+=(const Derivatives& other) {
    gradient += other.gradient;
    hessian += other.hessian;
    return *this;
  }
  friend Derivatives operator*(Derivatives a, double scale) {
    a.gradient *= scale;
    a.hessian *= scale;
    return a;
  }
};
using Channels = std::array<Derivatives, 3>;

/// Spacing of numbers that single precision holds up to the size of `largest`.
double spacing(double largest) { return std::ldexp(1.0, std::ilogb(std::max(largest, 1e-30)) + 1 - 23); }

Vec3d on_lattice(const Vec3d& v, const Vec3d& spacings) { return glm::round(v / spacings) * spacings; }

/// Three orthogonal directions, turned at random.
Mat3d random_axes(RandomStream& random) {
  const Frame frame = Frame::from_normal(square_to_uniform_sphere(random.next_vec2()));
  const double angle = 2 * 3.14159265358979323846 * static_cast<double>(random.next_float());
  const Vec3d tangent(frame.tangent);
  const Vec3d bitangent(frame.bitangent);
  return {std::cos(angle) * tangent + std::sin(angle) * bitangent,
          std::cos(angle) * bitangent - std::sin(angle) * tangent, Vec3d(frame.normal)};
}

/// Values at +-d for the three axes and the sums of two.
struct Level {
  Axes steps;
  std::array<std::array<ValueBatches, 2>, 6> values;  ///< axes 0, 1, 2; sums 01, 02, 12
};

constexpr std::array<std::array<size_t, 2>, 3> pairs{{{0, 1}, {0, 2}, {1, 2}}};

/// Derivatives of one batch; in the axes' directions first, then solved for x, y, z.
Channels differentiate(const Level& level, const ValueBatches& center, size_t batch) {
  const Mat3d inverse = glm::inverse(Mat3d(level.steps[0], level.steps[1], level.steps[2]));
  Channels channels;
  for (int c = 0; c < 3; ++c) {
    Vec3d slopes;
    std::array<double, 6> sums{};
    for (size_t i = 0; i < 6; ++i) {
      const double plus = level.values[i][0][batch][c];
      const double minus = level.values[i][1][batch][c];
      if (i < 3) slopes[static_cast<int>(i)] = 0.5 * (plus - minus);
      sums[i] = (plus - center[batch][c]) + (minus - center[batch][c]);
    }
    // s_i = d_i^T H d_i; the sum of two axes has s_i + s_j + 2 d_i^T H d_j.
    Mat3d curvature(0);
    for (int i = 0; i < 3; ++i) curvature[i][i] = sums[static_cast<size_t>(i)];
    for (size_t k = 0; k < pairs.size(); ++k) {
      const auto [i, j] = pairs[k];
      const double mixed = 0.5 * (sums[3 + k] - sums[i] - sums[j]);
      curvature[static_cast<int>(i)][static_cast<int>(j)] = mixed;
      curvature[static_cast<int>(j)][static_cast<int>(i)] = mixed;
    }
    const Mat3d hessian = glm::transpose(inverse) * curvature * inverse;
    Derivatives& result = channels[static_cast<size_t>(c)];
    result.gradient = glm::transpose(inverse) * slopes;
    for (int row = 0; row < 3; ++row)
      for (int column = row; column < 3; ++column)
        result.hessian(row, column) = 0.5 * (hessian[column][row] + hessian[row][column]);
  }
  return channels;
}

double gradient_size(const Channels& channels) {
  double sum = 0;
  for (const Derivatives& d : channels) sum += glm::dot(d.gradient, d.gradient);
  return std::sqrt(sum);
}
double hessian_size(const Channels& channels) {
  double sum = 0;
  for (const Derivatives& d : channels) sum += d.hessian.norm() * d.hessian.norm();
  return std::sqrt(sum);
}

Channels combine(const Channels& a, double weight_a, const Channels& b, double weight_b) {
  Channels result;
  for (size_t c = 0; c < 3; ++c) {
    result[c] = a[c] * weight_a;
    result[c] += b[c] * weight_b;
  }
  return result;
}

/// Mean over the batches, and the standard error of a size of it: root of the summed variances.
struct Averaged {
  Channels mean;
  double gradient_error = 0;
  double hessian_error = 0;
};

Averaged average_of(const std::vector<Channels>& batches) {
  Averaged result;
  const auto count = static_cast<double>(batches.size());
  for (const Channels& batch : batches) result.mean = combine(result.mean, 1, batch, 1 / count);
  if (batches.size() < 2) return result;
  for (const Channels& batch : batches) {
    const Channels deviation = combine(batch, 1, result.mean, -1);
    result.gradient_error += gradient_size(deviation) * gradient_size(deviation);
    result.hessian_error += hessian_size(deviation) * hessian_size(deviation);
  }
  result.gradient_error = std::sqrt(result.gradient_error / (count * (count - 1)));
  result.hessian_error = std::sqrt(result.hessian_error / (count * (count - 1)));
  return result;
}

/// Follows one derivative through the halvings.
class StepSearch {
 public:
  explicit StepSearch(double tolerance) : tolerance_(tolerance) {}

  bool settled() const { return settled_; }
  const Channels& result() const { return result_; }

  void begin(const Channels& first) { result_ = first; }
  /// `change`: size of fine - coarse; `error`: its standard error; `size`: that of fine.
  void add(const Channels& coarse, const Channels& fine, double change, double error, double size) {
    if (settled_ || !(change < least_change_)) return;
    least_change_ = change;
    const bool noisy = error > 0 && change <= 3 * error;
    result_ = noisy ? coarse : combine(fine, 4.0 / 3, coarse, -1.0 / 3);
    settled_ = noisy || change <= tolerance_ * size;
  }

 private:
  double tolerance_;
  bool settled_ = false;
  double least_change_ = std::numeric_limits<double>::infinity();
  Channels result_;
};

}  // namespace

RadianceJet central_differences(const ValueFunction& function, const Vec3d& x, const StepChoice& steps,
                                bool with_hessian, RandomStream& random) {
  const Mat3d turned = random_axes(random);
  const Vec3d reach = glm::abs(x) + Vec3d(2 * steps.first);
  const Vec3d spacings(spacing(reach.x), spacing(reach.y), spacing(reach.z));
  const Vec3d origin = on_lattice(x, spacings);
  const ValueBatches center = function(origin);

  const auto level_at = [&](double step) {
    Level level;
    for (int i = 0; i < 3; ++i) level.steps[static_cast<size_t>(i)] = on_lattice(turned[i] * step, spacings);
    for (size_t i = 0; i < 6; ++i) {
      if (i >= 3 && !with_hessian) {
        level.values[i] = {center, center};
        continue;
      }
      const Vec3d d = i < 3 ? level.steps[i] : level.steps[pairs[i - 3][0]] + level.steps[pairs[i - 3][1]];
      level.values[i] = {function(origin + d), function(origin - d)};
    }
    std::vector<Channels> batches;
    for (size_t batch = 0; batch < center.size(); ++batch)
      batches.push_back(differentiate(level, center, batch));
    return batches;
  };

  std::vector<Channels> coarse = level_at(steps.first);
  StepSearch gradient(steps.tolerance);
  StepSearch hessian(steps.tolerance);
  gradient.begin(average_of(coarse).mean);
  hessian.begin(average_of(coarse).mean);
  double step = steps.first;
  for (int32_t halving = 0; halving < steps.most_halvings; ++halving) {
    step *= 0.5;
    // Steps of a few lattice spacings are no longer in the directions they should be.
    if (step < 64 * std::max({spacings.x, spacings.y, spacings.z})) break;
    std::vector<Channels> fine = level_at(step);
    std::vector<Channels> changes;
    for (size_t batch = 0; batch < fine.size(); ++batch)
      changes.push_back(combine(fine[batch], 1, coarse[batch], -1));
    const Averaged change = average_of(changes);
    const Channels fine_mean = average_of(fine).mean;
    const Channels coarse_mean = average_of(coarse).mean;
    gradient.add(coarse_mean, fine_mean, gradient_size(change.mean), change.gradient_error,
                 gradient_size(fine_mean));
    hessian.add(coarse_mean, fine_mean, hessian_size(change.mean), change.hessian_error,
                hessian_size(fine_mean));
    if (gradient.settled() && (hessian.settled() || !with_hessian)) break;
    coarse = std::move(fine);
  }

  RadianceJet result;
  for (size_t c = 0; c < 3; ++c) {
    for (const Vec3d& batch : center)
      result.channels[c].value += batch[static_cast<int>(c)] / static_cast<double>(center.size());
    result.channels[c].gradient = gradient.result()[c].gradient;
    if (with_hessian) result.channels[c].hessian = hessian.result()[c].hessian;
  }
  return result;
}

}  // namespace fogbank::derivatives
