#include "cache/store/emission.h"

#include <tbb/parallel_for.h>

#include <cmath>

#include "cache/store/bytes.h"
#include "core/error.h"

namespace fogbank::cache {
namespace {

constexpr float tolerance = 1e-6f;

std::string text_of(const Spectrum& factor) {
  const auto number = [](float value) {
    std::string text = std::to_string(value);
    while (text.ends_with('0')) text.pop_back();
    if (text.ends_with('.')) text.pop_back();
    return text;
  };
  if (factor.x == factor.y && factor.y == factor.z) return number(factor.x);
  return "(" + number(factor.x) + ", " + number(factor.y) + ", " + number(factor.z) + ")";
}

}  // namespace

bool depends_on_emission(Quantity quantity) { return quantity != Quantity::ratio; }

std::optional<Spectrum> common_factor(const std::vector<Spectrum>& from, const std::vector<Spectrum>& to) {
  if (from.size() != to.size()) return std::nullopt;
  Spectrum factor(1);
  for (int channel = 0; channel < 3; ++channel) {
    // The brightest emitter's, which rounding matters least for.
    float brightest = 0;
    for (size_t i = 0; i < from.size(); ++i) {
      if (!(from[i][channel] > brightest)) continue;
      brightest = from[i][channel];
      factor[channel] = to[i][channel] / from[i][channel];
    }
    if (!std::isfinite(factor[channel]) || !(factor[channel] > 0)) return std::nullopt;
    for (size_t i = 0; i < from.size(); ++i)
      if (!(std::fabs(from[i][channel] * factor[channel] - to[i][channel]) <= tolerance * to[i][channel]))
        return std::nullopt;
  }
  return factor;
}

Record scaled(const Record& record, const Spectrum& factor) {
  Record result = record;
  result.radiance *= factor;
  for (int channel = 0; channel < 3; ++channel)
    result.gradient[static_cast<size_t>(channel)] *= factor[channel];
  const float before = luminance(record.radiance);
  const float ratio = before > 0 ? luminance(result.radiance) / before : luminance(factor);
  result.hessian = ratio * record.hessian;
  result.variance *= ratio * ratio;
  std::string settings = "scaled";
  append_bytes(settings, factor);
  result.id = content_id(record.position, record.component, settings, record.id);
  return result;
}

std::vector<SegmentPart> parts_of(const std::vector<Spectrum>& emission, const RecordSet& records) {
  std::vector<Record> independent;
  std::vector<Record> dependent;
  for (size_t i = 0; i < records.size(); ++i) {
    const Record record = records.record(i);
    (depends_on_emission(record.component.quantity) ? dependent : independent).push_back(record);
  }
  std::vector<SegmentPart> parts;
  if (!independent.empty()) parts.push_back({{}, RecordSet(std::move(independent))});
  if (!dependent.empty()) parts.push_back({emission, RecordSet(std::move(dependent))});
  return parts;
}

RecordSet usable_records(std::vector<SegmentPart> parts, const std::vector<Spectrum>& emission,
                         std::vector<std::string>& notes) {
  RecordSet result;
  const auto add = [&](RecordSet&& records) {
    result = result.size() == 0 ? std::move(records) : merge(result, records);
  };
  uint64_t ratios = 0;
  size_t others = 0;
  for (SegmentPart& part : parts) {
    const std::string count = std::to_string(part.records.size()) + " records";
    if (part.emission.empty() || part.emission == emission) {
      if (part.emission.empty()) ratios = part.records.size();
      add(std::move(part.records));
      continue;
    }
    ++others;
    const std::optional<Spectrum> factor = common_factor(part.emission, emission);
    if (!factor) {
      notes.push_back(count +
                      " made under another emission aren't used: emitters changed by different factors, and "
                      "records don't tell one emitter's light from another's");
      continue;
    }
    std::vector<Record> records(part.records.size());
    tbb::parallel_for(size_t{0}, records.size(),
                      [&](size_t i) { records[i] = scaled(part.records.record(i), *factor); });
    part.records = {};
    try {
      add(RecordSet(std::move(records)));
      notes.push_back(count + " made under another emission are used times " + text_of(*factor) +
                      ": all emitters changed by that factor");
    } catch (const Error&) {
      notes.push_back(count + " made under another emission aren't used: times " + text_of(*factor) +
                      " they are beyond what numbers hold");
    }
  }
  if (others > 0 && ratios > 0)
    notes.push_back(std::to_string(ratios) +
                    " records of visibility are used whatever the emission: they are ratios to it");
  return result;
}

}  // namespace fogbank::cache
