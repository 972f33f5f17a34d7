#include "render/job_log.h"

#include <cmath>

#include "cache/store/bytes.h"
#include "cache/store/segment.h"
#include "core/error.h"
#include "core/sha256.h"

namespace fogbank::render {

using cache::append_bytes;
using cache::ByteReader;

namespace {

/// The records' own fingerprints say what they belong to: the replica has the same scene.
const std::string any_transport(64, '0');

[[noreturn]] void refuse(const std::string& why) {
  throw Error(ErrorKind::invalid_argument, "INVALID_LOG", "the log can't be replayed: " + why);
}

// A step is the number of its kind and what follows here.

std::string payload(const StartStep& step) {
  return cache::seal_segment(any_transport, {{.emission = {}, .records = step.records}}).bytes;
}

std::string payload(const BeginStep& step) {
  std::string bytes;
  append_bytes(bytes, step.target.error);
  append_bytes(bytes, static_cast<uint8_t>(step.target.preview));
  return bytes;
}

std::string payload(const RoundStep& step) {
  std::string bytes;
  append_bytes(bytes, step.next_tasks);
  append_bytes(bytes, step.records);
  return bytes + step.outcome;
}

std::string payload(const DropStep& step) {
  std::string bytes;
  append_bytes(bytes, step.records);
  return bytes + step.outcome;
}

LogStep start_step(std::string_view bytes) {
  cache::Segment segment;
  try {
    segment = cache::open_segment(bytes, "records");
  } catch (const Error& error) {
    refuse(error.what());
  }
  if (segment.parts.size() > 1) refuse("records of several emissions");
  StartStep step;
  if (!segment.parts.empty()) step.records = std::move(segment.parts.front().records);
  return step;
}

LogStep to_step(std::string_view bytes) {
  ByteReader reader(bytes);
  const auto kind = reader.take<uint8_t>();
  switch (kind) {
    case 0:
      return start_step(bytes.substr(1));
    case 1: {
      BeginStep step;
      step.target.error = reader.take<double>();
      step.target.preview = reader.take<uint8_t>() != 0;
      if (!reader.ok() || reader.left() > 0 || !(step.target.error > 0) || !std::isfinite(step.target.error))
        refuse("a preparation without a target");
      return step;
    }
    case 2: {
      RoundStep step;
      step.next_tasks = reader.take<uint32_t>();
      step.records = reader.take<uint64_t>();
      step.outcome = reader.take(reader.left());
      if (!reader.ok()) refuse("a round ends too soon");
      return step;
    }
    case 3: {
      DropStep step;
      step.records = reader.take<uint64_t>();
      step.outcome = reader.take(reader.left());
      if (!reader.ok()) refuse("a dropped round ends too soon");
      return step;
    }
    default:
      refuse("there is no such step");
  }
}

}  // namespace

// An entry is a byte that tells whether the step ends with it, and a part of the step.

void JobLog::add(const LogStep& step) {
  std::string bytes(1, static_cast<char>(step.index()));
  bytes += std::visit([](const auto& kind) { return payload(kind); }, step);
  std::vector<std::shared_ptr<const Entry>> added;
  for (size_t first = 0; first < bytes.size(); first += most_entry_bytes - 1) {
    const std::string_view part = std::string_view(bytes).substr(first, most_entry_bytes - 1);
    auto entry = std::make_shared<Entry>();
    entry->data.push_back(static_cast<char>(first + part.size() == bytes.size()));
    entry->data += part;
    entry->sha256 = sha256(entry->data);
    added.push_back(std::move(entry));
  }
  const std::lock_guard lock(mutex_);
  if (bytes_ + bytes.size() > most_bytes) {
    throw Error(ErrorKind::resource_exhausted, "LOG_TOO_LARGE",
                "a leased job's log may have " + std::to_string(most_bytes) + " bytes");
  }
  bytes_ += bytes.size();
  entries_.insert(entries_.end(), added.begin(), added.end());
  ++steps_;
}

uint32_t JobLog::steps() const {
  const std::lock_guard lock(mutex_);
  return steps_;
}

uint64_t JobLog::length() const {
  const std::lock_guard lock(mutex_);
  return entries_.size();
}

std::shared_ptr<const JobLog::Entry> JobLog::entry(uint64_t index) const {
  const std::lock_guard lock(mutex_);
  return entries_.at(index);
}

std::optional<LogStep> JobLogReader::read(std::string_view entry) {
  if (entry.empty() || entry.size() > JobLog::most_entry_bytes || static_cast<uint8_t>(entry.front()) > 1)
    refuse("an entry is damaged");
  if (part_.size() + entry.size() > JobLog::most_bytes) refuse("a step is too large");
  const bool last = entry.front() != 0;
  const std::string_view part = entry.substr(1);
  std::optional<LogStep> step;
  if (last) step = to_step(part_.empty() ? std::string(part) : part_ + std::string(part));
  if (last) {
    part_.clear();
  } else {
    part_ += part;
  }
  ++length_;
  return step;
}

}  // namespace fogbank::render
