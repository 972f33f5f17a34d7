// What the tasks and rounds of a fill bring, as bytes.
#include <algorithm>

#include "cache/record_bytes.h"
#include "integrators/radiance_cache_fill.h"

namespace fogbank::integrators {

namespace {

/// Of samples behind records: beyond are more than numbers hold.
constexpr uint32_t greatest_level = 10;

std::string bytes_of(const std::vector<cache::Wish>& wishes) {
  std::string bytes;
  cache::append_bytes(bytes, static_cast<uint32_t>(wishes.size()));
  for (const cache::Wish& wish : wishes) cache::append_wish(bytes, wish);
  return bytes;
}

std::string bytes_of(const std::vector<cache::SpacedWish>& wishes) {
  std::string bytes;
  cache::append_bytes(bytes, static_cast<uint32_t>(wishes.size()));
  for (const cache::SpacedWish& wish : wishes) cache::append_wish(bytes, wish);
  return bytes;
}

}  // namespace

void RadianceCacheFill::check(const cache::Component& component, uint8_t generation) const {
  const auto media = static_cast<int32_t>(integrator_.world()->scene().media.size());
  const bool on_surface = component.quantity == cache::Quantity::irradiance;
  if (component.medium >= media || component.medium < (on_surface ? scene::none : 0))
    cache::refuse_poisoned("the scene has no medium " + std::to_string(component.medium));
  if (component.scattering_order > generation) cache::refuse_poisoned("a generation is none of this fill's");
  if (on_surface || component.quantity == cache::Quantity::ratio) return;
  const CacheTechnique& technique = integrator_.technique();
  const transport::MediumInfo& medium = integrator_.world()->medium(component.medium);
  if (component.quantity != technique.rest(medium) && component.quantity != technique.direct(medium))
    cache::refuse_poisoned("a quantity is none of this integrator's");
}

std::vector<cache::Wish> RadianceCacheFill::take_wishes(cache::ByteReader& reader, uint8_t generation) const {
  std::vector<cache::Wish> wishes(cache::take_count(reader, cache::wish_bytes));
  for (cache::Wish& wish : wishes) {
    wish = cache::take_wish(reader);
    check(wish.component, generation);
  }
  return wishes;
}

void RadianceCacheFill::check_granted(const cache::Record& record, const cache::Wish& wish) {
  if (record.position != wish.position || record.component != wish.component)
    cache::refuse_poisoned("a record is of another place");
  if (record.id == 0) cache::refuse_poisoned("a record has no id");
}

std::string RadianceCacheFill::result(uint32_t task) const {
  std::string bytes;
  switch (round_) {
    case Round::pilot:
      integrator_.pilot().append_to(bytes, task);
      break;
    case Round::probing:
      return bytes_of(found_[task]);
    case Round::surveying:
      return noise_[task].bytes();
    case Round::making:
    case Round::refining:
      cache::append_record(bytes, made_[task]);
      break;
    case Round::begin:
    case Round::done:
      break;
  }
  return bytes;
}

void RadianceCacheFill::accept(uint32_t task, std::string_view result) {
  cache::ByteReader reader(result);
  switch (round_) {
    case Round::pilot: {
      const std::optional<cache::Record> record = integrator_.pilot().take_record(reader, task);
      cache::expect_end(reader);
      integrator_.pilot().set(task, record);
      break;
    }
    case Round::probing: {
      std::vector<cache::SpacedWish> found(cache::take_count(reader, cache::spaced_wish_bytes));
      for (cache::SpacedWish& wish : found) {
        wish = cache::take_spaced_wish(reader);
        check(wish.wish.component, generation_);
      }
      cache::expect_end(reader);
      found_[task] = std::move(found);
      break;
    }
    case Round::surveying:
      noise_[task] = RecordNoise::from_bytes(*integrator_.published().epoch, result);
      break;
    case Round::making:
    case Round::refining: {
      const cache::Record record = cache::take_record(reader);
      check_granted(record, granted_[task]);
      cache::expect_end(reader);
      made_[task] = record;
      break;
    }
    case Round::begin:
    case Round::done:
      break;
  }
}

std::string RadianceCacheFill::outcome() {
  settle();
  std::string bytes;
  switch (round_) {
    case Round::pilot:
      for (uint32_t place = 0; place < integrator_.pilot().count(); ++place)
        integrator_.pilot().append_to(bytes, place);
      break;
    case Round::probing:
      return bytes_of(granted_);
    case Round::surveying:
      bytes = bytes_of(granted_);
      for (const uint32_t level : levels_) cache::append_bytes(bytes, level);
      break;
    case Round::making:
    case Round::refining:
      // Those of a round that was dropped may be missing.
      for (const cache::Record& record : made_) {
        const bool done = record.id != 0;
        cache::append_record(bytes, done ? std::optional(record) : std::nullopt);
      }
      break;
    case Round::begin:
    case Round::done:
      break;
  }
  return bytes;
}

void RadianceCacheFill::adopt(std::string_view outcome) {
  cache::ByteReader reader(outcome);
  switch (round_) {
    case Round::pilot:
      for (uint32_t place = 0; place < integrator_.pilot().count(); ++place)
        integrator_.pilot().set(place, integrator_.pilot().take_record(reader, place));
      break;
    case Round::probing:
      granted_ = take_wishes(reader, generation_);
      break;
    case Round::surveying:
      granted_ = take_wishes(reader, generation_);
      levels_.resize(granted_.size());
      for (uint32_t& level : levels_) {
        level = reader.take<uint32_t>();
        if (level > greatest_level) cache::refuse_poisoned("a place has no record of such a number");
      }
      break;
    case Round::making:
    case Round::refining:
      for (size_t i = 0; i < made_.size(); ++i) {
        const std::optional<cache::Record> record = cache::take_optional_record(reader);
        if (record) check_granted(*record, granted_[i]);
        made_[i] = record.value_or(cache::Record{});
      }
      break;
    case Round::begin:
    case Round::done:
      break;
  }
  cache::expect_end(reader);
  settled_ = true;
}

}  // namespace fogbank::integrators
