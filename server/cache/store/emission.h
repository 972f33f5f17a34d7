// Records under another emission than they were made with. Light is linear in emission, channel by channel:
// if all emitters change by one factor, so do all records; ratios to a light's proxy don't depend on
// emission.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cache/store/segment.h"

namespace fogbank::cache {

/// Whether records of a quantity change with the emitters' brightness.
bool depends_on_emission(Quantity quantity);

/// Factor of each channel that turns emission `from` into `to`, to 1e-6 of each emitter's; nullopt where
/// emitters changed by different factors. 1 in channels that no emitter has.
std::optional<Spectrum> common_factor(const std::vector<Spectrum>& from, const std::vector<Spectrum>& to);

/// The record if all emission is `factor` (> 0) times what it was. Exact but for the Hessian and the
/// variance, which are the luminance's: they scale as the luminance does. It has an id of its own.
Record scaled(const Record& record, const Spectrum& factor);

/// `records` by what they depend on: nothing, and `emission`.
std::vector<SegmentPart> parts_of(const std::vector<Spectrum>& emission, const RecordSet& records);

/// Everything in `parts` that says something about a scene with `emission`; `notes` is told, in sentences,
/// what was scaled and what was of no use.
RecordSet usable_records(std::vector<SegmentPart> parts, const std::vector<Spectrum>& emission,
                         std::vector<std::string>& notes);

}  // namespace fogbank::cache
