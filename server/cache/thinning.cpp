#include "cache/thinning.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <unordered_map>

#include "core/random.h"

namespace fogbank::cache {

namespace {

bool similar(const Wish& a, const Wish& b) {
  return a.normal == Vec3f(0) ? b.normal == Vec3f(0) : glm::dot(a.normal, b.normal) >= similar_normals;
}

/// Places by cell of a regular grid, of the size of the longest distance that is ever asked for.
class Neighbourhood {
 public:
  explicit Neighbourhood(float reach) : reach_(reach) {}

  void add(const Wish& wish) { cells_[key(cell(wish.position))].push_back(wish); }

  /// Distance to the nearest similar place; reach at most.
  float nearest(const Wish& wish) const {
    float nearest2 = reach_ * reach_;
    const glm::ivec3 middle = cell(wish.position);
    for (int dz = -1; dz <= 1; ++dz)
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const auto found = cells_.find(key(middle + glm::ivec3(dx, dy, dz)));
          if (found == cells_.end()) continue;
          for (const Wish& other : found->second) {
            const Vec3f offset = other.position - wish.position;
            const float distance2 = glm::dot(offset, offset);
            if (distance2 < nearest2 && similar(wish, other)) nearest2 = distance2;
          }
        }
    return std::sqrt(nearest2);
  }

 private:
  glm::ivec3 cell(const Vec3f& position) const { return glm::ivec3(glm::floor(position / reach_)); }
  static uint64_t key(const glm::ivec3& cell) {
    const auto bits = [](int32_t value) {
      return static_cast<uint64_t>(static_cast<uint32_t>(value)) & 0x1fffff;
    };
    return bits(cell.x) | bits(cell.y) << 21 | bits(cell.z) << 42;
  }

  float reach_;
  std::unordered_map<uint64_t, std::vector<Wish>> cells_;
};

}  // namespace

std::vector<uint32_t> thin(std::span<const Wish> wishes, std::span<const Wish> existing,
                           float greatest_spacing, uint64_t seed, size_t most) {
  struct Ranked {
    uint64_t rank;
    uint32_t wish;
  };
  std::vector<Ranked> order(wishes.size());
  for (uint32_t i = 0; i < wishes.size(); ++i) {
    const Vec3f& p = wishes[i].position;
    const auto bits = philox4x32(
        {std::bit_cast<uint32_t>(p.x), std::bit_cast<uint32_t>(p.y), std::bit_cast<uint32_t>(p.z), 0},
        {static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)});
    order[i] = {uint64_t{bits[0]} << 32 | bits[1], i};
  }
  std::ranges::sort(order, [](const Ranked& a, const Ranked& b) {
    return a.rank != b.rank ? a.rank < b.rank : a.wish < b.wish;
  });
  Neighbourhood before(greatest_spacing);
  for (const Wish& wish : existing) before.add(wish);
  Neighbourhood granted(greatest_spacing);
  std::vector<uint32_t> result;
  for (const Ranked& ranked : order) {
    if (result.size() >= most) break;
    const Wish& wish = wishes[ranked.wish];
    if (granted.nearest(wish) < before.nearest(wish)) continue;
    granted.add(wish);
    result.push_back(ranked.wish);
  }
  std::ranges::sort(result);
  return result;
}

}  // namespace fogbank::cache
