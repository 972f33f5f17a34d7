#include "cache/thinning.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <unordered_map>

#include "cache/metric.h"
#include "core/random.h"

namespace fogbank::cache {

namespace {

bool similar(const Wish& a, const Wish& b) {
  return a.normal == Vec3f(0) ? b.normal == Vec3f(0) : glm::dot(a.normal, b.normal) >= similar_normals;
}

/// Granted wishes of one component in regular grids, one for each power of two of spacings, whose cells are
/// as wide as the longest spacing in them: who may forbid a place lies in the cells around it.
class Granted {
 public:
  void add(const SpacedWish& wish) {
    const int level = std::ilogb(wish.spacing);
    grids_[level][key(cell(wish.wish.position, level))].push_back(wish);
  }

  bool forbids(const Wish& wish) const {
    for (const auto& [level, cells] : grids_) {
      const glm::ivec3 middle = cell(wish.position, level);
      for (int neighbour = 0; neighbour < 27; ++neighbour) {
        const glm::ivec3 offset(neighbour % 3 - 1, neighbour / 3 % 3 - 1, neighbour / 9 - 1);
        const auto found = cells.find(key(middle + offset));
        if (found == cells.end()) continue;
        for (const SpacedWish& other : found->second)
          if (glm::distance(other.wish.position, wish.position) < other.spacing && similar(other.wish, wish))
            return true;
      }
    }
    return false;
  }

 private:
  static glm::ivec3 cell(const Vec3f& position, int level) {
    return glm::ivec3(glm::floor(position * std::ldexp(1.0f, -level - 1)));
  }
  /// Cells that share a key are only searched together.
  static uint64_t key(const glm::ivec3& cell) {
    const auto bits = [](int32_t value) {
      return static_cast<uint64_t>(static_cast<uint32_t>(value)) & 0x1fffff;
    };
    return bits(cell.x) | bits(cell.y) << 21 | bits(cell.z) << 42;
  }

  std::map<int, std::unordered_map<uint64_t, std::vector<SpacedWish>>> grids_;
};

}  // namespace

std::vector<uint32_t> thin(std::span<const SpacedWish> wishes, uint64_t seed, size_t most) {
  struct Ranked {
    uint64_t rank;
    uint32_t wish;
  };
  std::vector<Ranked> order(wishes.size());
  for (uint32_t i = 0; i < wishes.size(); ++i) {
    const Vec3f& p = wishes[i].wish.position;
    const auto bits = philox4x32(
        {std::bit_cast<uint32_t>(p.x), std::bit_cast<uint32_t>(p.y), std::bit_cast<uint32_t>(p.z), 0},
        {static_cast<uint32_t>(seed), static_cast<uint32_t>(seed >> 32)});
    order[i] = {uint64_t{bits[0]} << 32 | bits[1], i};
  }
  std::ranges::sort(order, [](const Ranked& a, const Ranked& b) {
    return a.rank != b.rank ? a.rank < b.rank : a.wish < b.wish;
  });
  std::map<Component, Granted> granted;
  std::vector<uint32_t> result;
  for (const Ranked& ranked : order) {
    if (result.size() >= most) break;
    const SpacedWish& wish = wishes[ranked.wish];
    Granted& before = granted[wish.wish.component];
    if (before.forbids(wish.wish)) continue;
    before.add(wish);
    result.push_back(ranked.wish);
  }
  return result;
}

}  // namespace fogbank::cache
