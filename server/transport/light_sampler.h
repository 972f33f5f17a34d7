// Choice of one light among many, at a point or along a medium segment, with probabilities that follow what
// each light could contribute unoccluded: a binary tree over the lights at finite places with bounds on power
// and orientation (Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
// Splitting"), exact proxies in its leaves, and the lights at infinity beside its root.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "transport/distance_table.h"
#include "transport/light.h"
#include "transport/medium_segment.h"

namespace fogbank::transport {

struct LightChoice {
  uint32_t light = 0;
  float probability = 0;
};

/// Lights that a choice is made among.
enum class LightSubset : uint8_t {
  all,
  besides_parallel,  ///< without LightSampler::parallel_lights()
};

/// Where direct light is wanted on a surface or at a scattering point.
struct LightReceiver {
  Vec3f position{0};
  Vec3f normal{
      0};  ///< shading normal on the side that is lit; zero for media and for surfaces lit from both sides
  float mean_sigma_t = 0;  ///< of the medium around
};

class LightSampler {
 public:
  static constexpr size_t most_infinite_lights = 15;
  static constexpr size_t most_parallel_lights = 4;

  /// Throws Error(resource_exhausted, "TOO_MANY_INFINITE_LIGHTS").
  explicit LightSampler(std::vector<LightPointer> lights);

  size_t size() const { return lights_.size(); }
  const Light& light(uint32_t index) const { return *lights_[index]; }
  const std::vector<uint32_t>& infinite_lights() const { return infinite_; }
  /// The directional lights where they are so few that each can be sampled for itself; else none.
  const std::vector<uint32_t>& parallel_lights() const { return parallel_; }

  /// `u` is canonical and is rescaled to a fresh canonical number. nullopt when no light reaches.
  std::optional<LightChoice> choose(const LightReceiver& receiver, float& u) const;
  float probability(const LightReceiver& receiver, uint32_t light,
                    LightSubset subset = LightSubset::all) const;
  std::optional<LightChoice> choose(const MediumSegment& segment, float& u) const;
  float probability(const MediumSegment& segment, uint32_t light) const;
  /// The same for several numbers at once; a probability of 0 stands for no light. Ascending numbers give the
  /// samples of one light in a row.
  void choose(const LightReceiver& receiver, LightSubset subset, std::span<float> u,
              std::span<LightChoice> choices) const;
  void choose(const MediumSegment& segment, LightSubset subset, std::span<float> u,
              std::span<LightChoice> choices) const;

 private:
  struct Node {
    LightBounds bounds;
    uint32_t first =
        0;  ///< leaf: first entry of order_; inner: index of the right child (the left one follows)
    uint32_t count = 0;  ///< leaf: number of lights; inner: 0
  };

  static constexpr uint32_t leaf_size = 4;

  /// What the choice begins with: every light at infinity, then the tree, or the tree's lights themselves
  /// where it is a single leaf.
  struct Top {
    std::array<float, most_infinite_lights + leaf_size> weights{};
    size_t count = 0;
    float total = 0;
  };

  template <typename Place>
  Top top_of(const Place& place, LightSubset subset = LightSubset::all) const;
  template <typename Place>
  std::optional<LightChoice> choose_from(const Top& top, const Place& place, float& u) const;
  template <typename Place>
  void choose_all(const Place& place, LightSubset subset, std::span<float> u,
                  std::span<LightChoice> choices) const;
  template <typename Place>
  float probability_at(const Place& place, uint32_t light, LightSubset subset) const;
  uint32_t build(uint32_t first, uint32_t count, uint32_t depth, uint64_t trail);

  bool is_flat() const { return nodes_.empty() || nodes_[0].count > 0; }

  std::vector<LightPointer> lights_;
  std::vector<uint32_t> infinite_;
  std::vector<uint32_t> parallel_;
  std::vector<uint32_t> order_;  ///< finite lights, leaf by leaf
  std::vector<Node> nodes_;
  std::vector<uint64_t> trails_;  ///< per light: left/right bits from the root
};

}  // namespace fogbank::transport
