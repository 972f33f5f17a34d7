// The two-dimensional cache: records with their extents, and look-up.
#pragma once

#include <optional>
#include <vector>

#include "cache/flatland/ellipse.h"
#include "cache/flatland/record.h"

namespace fogbank::cache::flatland {

/// Extents are a function of the set of records and of settings, as in space (extents.h): all guards are
/// minima over pairs that see unguarded extents only, so a record may come at any time and the order does not
/// matter. Sums of a look-up are in the order of the records.
class Cache {
 public:
  /// Settings are valid, `radiance_floor` > 0.
  Cache(const Settings& settings, double radiance_floor)
      : settings_(settings), radiance_floor_(radiance_floor) {}

  /// Linear in the records.
  void add(const Record& record);

  /// Blend of the records that reach the point, weights w = 3 d^2 - 2 d^3 with d = 1 - sqrt(dx^T Q dx)
  /// (method.md section 11); nothing where none does. Linear in the records.
  std::optional<double> look_up(const Vec2d& point) const;

  size_t size() const { return records_.size(); }
  const Record& record(size_t i) const { return records_[i]; }
  const Ellipse& extent(size_t i) const { return extents_[i].guarded; }

 private:
  struct Extent {
    Ellipse base;
    double scale = 1;  ///< guard 3: least factor that a neighbour asks for
    double bound = 0;  ///< guard 1: min over j of (R_j + |x_i - x_j|)
    Ellipse guarded;
  };

  void guard(size_t i, size_t j);
  void apply(Extent& extent) const;

  Settings settings_;
  double radiance_floor_;
  std::vector<Record> records_;
  std::vector<Extent> extents_;
};

}  // namespace fogbank::cache::flatland
