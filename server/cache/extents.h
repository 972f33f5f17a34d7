// The extents of all records of a component: metric and guards, a function of the set and the settings.
// Computed for a threshold, never stored.
#pragma once

#include "cache/ellipsoid_tree.h"
#include "cache/metric.h"
#include "cache/record_set.h"

namespace fogbank::cache {

/// Ellipsoid of each place of `range`: base_ellipsoid(), shrunk
///   - where a neighbour that it holds contradicts its extrapolation (guard 3 of method.md section 10.4; on
///   surfaces only one of a similar normal counts; the least
///     factor over all pairs, tested with the base ellipsoids),
///   - to what neighbours reach (guard 1, on the longest semi-axes of the base ellipsoids),
/// and never below the minimum radius. Where that is what counts the gradient is cut down (gradient_share) by
/// which the shortest semi-axis, on surfaces of those along it, grew: over the whole extent radiance changes
/// no more than it would over the one that metric and guards grant. Gradients in full made pictures too
/// bright, since extrapolation has a bound at 0 and a higher one above. Pairs and bounds refer to the
/// unguarded ellipsoids, hence no order of records enters. `settings` are valid.
std::vector<Ellipsoid> guarded_ellipsoids(const RecordSet& set, const ComponentRange& range,
                                          const MetricSettings& settings);

/// Greatest relative error that the metric admits anywhere in an ellipsoid with this product of semi-axes: at
/// the border of a ball, if one eigenvalue is all there is, 15 eps/(4 pi a b c); but no less than 0.5 %.
double verify_tolerance(double threshold, const Ellipsoid& ellipsoid);
/// The same of an extent on a surface, whose threshold is surface_threshold(): 4 eps/(pi a b).
double verify_tolerance_on_surface(double threshold, const Ellipsoid& ellipsoid);

}  // namespace fogbank::cache
