#include "service/scheduling/tile_board.h"

#include <iterator>

namespace fogbank::service {

TileBoard TileBoard::published(uint32_t tile_count, uint64_t revision) {
  TileBoard board(tile_count, Clock::duration::zero(), revision);
  for (uint32_t tile = 0; tile < tile_count; ++tile) board.publish(tile, Clock::time_point::min());
  return board;
}

void TileBoard::complete(uint32_t tile, Clock::time_point now) {
  TileState& state = tiles_[tile];
  if (state.revision == 0) {
    publish(tile, now);
  } else if (!state.deferred) {
    state.deferred = true;
    deferred_.emplace(state.published + interval_, tile);
  }
}

void TileBoard::publish_due(Clock::time_point now) {
  while (!deferred_.empty() && deferred_.begin()->first <= now) {
    const uint32_t tile = deferred_.begin()->second;
    deferred_.erase(deferred_.begin());
    publish(tile, now);
  }
}

void TileBoard::publish_all(Clock::time_point now) {
  for (const auto& [due, tile] : deferred_) publish(tile, now);
  deferred_.clear();
}

std::optional<Clock::time_point> TileBoard::next_due() const {
  if (deferred_.empty()) return std::nullopt;
  return deferred_.begin()->first;
}

std::optional<TileBoard::Update> TileBoard::next_after(uint64_t revision) const {
  const auto found = by_revision_.upper_bound(revision);
  if (found == by_revision_.end()) return std::nullopt;
  return Update{.tile = found->second, .revision = found->first};
}

size_t TileBoard::count_after(uint64_t revision) const {
  return static_cast<size_t>(std::distance(by_revision_.upper_bound(revision), by_revision_.end()));
}

void TileBoard::publish(uint32_t tile, Clock::time_point now) {
  TileState& state = tiles_[tile];
  if (state.revision != 0) by_revision_.erase(state.revision);
  state.revision = ++revision_;
  state.published = now;
  state.deferred = false;
  by_revision_.emplace_hint(by_revision_.end(), state.revision, tile);
}

}  // namespace fogbank::service
