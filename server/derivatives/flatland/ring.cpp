#include "derivatives/flatland/ring.h"

#include <bit>
#include <numbers>

#include "core/random.h"

namespace fogbank::derivatives::flatland {

namespace {

/// Surfaces that may come to light within one gap.
constexpr int most_boundaries = 8;

uint32_t fold(double number) {
  const auto bits = std::bit_cast<uint64_t>(number);
  return static_cast<uint32_t>(bits ^ (bits >> 32));
}

class RingBuilder {
 public:
  RingBuilder(const Scene& scene, const Vec2d& x) : scene_(scene), x_(x) {}

  Sight look(double angle, bool stratified) {
    ++ring_.rays;
    const Vec2d direction(std::cos(angle), std::sin(angle));
    return {angle, direction, scene_.trace(x_, direction), stratified};
  }

  void add(const Sight& sight) { ring_.sights.push_back(sight); }

  void bisect(Sight low, const Sight& high, int bisections) {
    for (int boundary = 0; boundary < most_boundaries; ++boundary) {
      const int surface = low.hit.surface;
      if (surface == high.hit.surface) return;
      if (!scene_.is_segment(surface) && !scene_.is_segment(high.hit.surface)) return;
      Sight next = high;
      bool low_is_new = false;
      for (int step = 0; step < bisections; ++step) {
        const Sight middle = look((low.angle + next.angle) / 2, false);
        if (middle.hit.surface == surface) {
          low = middle;
          low_is_new = true;
        } else {
          next = middle;
        }
      }
      if (low_is_new) add(low);
      if (next.angle == high.angle) return;
      add(next);
      low = next;
    }
  }

  Ring take() { return std::move(ring_); }

 private:
  const Scene& scene_;
  Vec2d x_;
  Ring ring_;
};

}  // namespace

Ring make_ring(const Scene& scene, const Vec2d& x, int samples, int bisections, uint64_t seed) {
  RandomStream random(seed, fold(x.x), fold(x.y), 0);
  RingBuilder builder(scene, x);
  std::vector<Sight> strata;
  strata.reserve(static_cast<size_t>(samples) + 1);
  // Half jitter under a random turn, as the sphere grid's (method.md section 2.1): each ray is uniform over
  // the ring by itself, so means stay unbiased, and gaps between neighbours are more even.
  const double turn = random.next_float();
  for (int i = 0; i < samples; ++i) {
    const double place = i + turn + 0.5 * (random.next_float() - 0.5f);
    strata.push_back(builder.look(2 * std::numbers::pi * place / samples, true));
  }
  strata.push_back(strata.front());
  strata.back().angle += 2 * std::numbers::pi;
  for (size_t i = 0; i + 1 < strata.size(); ++i) {
    builder.add(strata[i]);
    if (bisections > 0) builder.bisect(strata[i], strata[i + 1], bisections);
  }
  return builder.take();
}

}  // namespace fogbank::derivatives::flatland
