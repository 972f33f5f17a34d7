#include "cache/store/manifest.h"

#include <xxhash.h>

#include <algorithm>
#include <charconv>

#include "core/error.h"

namespace fogbank::cache {
namespace {

constexpr uint64_t version = 1;
constexpr std::string_view first_word = "fogbank cache ";

[[noreturn]] void damaged(const std::string& file, const std::string& what) {
  throw Error(ErrorKind::data_loss, "MANIFEST_DAMAGED", file + ": " + what);
}

std::string checksum(std::string_view text) {
  uint64_t value = XXH3_64bits(text.data(), text.size());
  std::string digits(16, '0');
  for (size_t i = 16; i-- > 0; value >>= 4) digits[i] = "0123456789abcdef"[value & 15];
  return digits;
}

/// Words of one line, taken from the front.
class Words {
 public:
  explicit Words(std::string_view line) : left_(line) {}

  std::string_view take() {
    const size_t end = std::min(left_.find(' '), left_.size());
    const std::string_view word = left_.substr(0, end);
    left_.remove_prefix(std::min(end + 1, left_.size()));
    return word;
  }
  template <typename T>
  bool number(T& value) {
    const std::string_view word = take();
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    return error == std::errc() && end == word.data() + word.size() && !word.empty();
  }
  bool empty() const { return left_.empty(); }

 private:
  std::string_view left_;
};

}  // namespace

bool Manifest::names(const std::string& sha256) const {
  return std::ranges::find(segments, sha256, &SegmentEntry::sha256) != segments.end();
}

bool is_sha256(std::string_view text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

std::string to_text(const Manifest& manifest) {
  std::string text = std::string(first_word) + std::to_string(version) + "\n";
  text += "transport " + manifest.transport + "\n";
  text += "epoch " + std::to_string(manifest.epoch) + "\n";
  for (const SegmentEntry& segment : manifest.segments)
    text += "segment " + segment.sha256 + " " + std::to_string(segment.bytes) + " " +
            std::to_string(segment.records) + " " + std::to_string(segment.epoch) + " " +
            std::to_string(segment.sealed_at) + "\n";
  return text + "checksum " + checksum(text) + "\n";
}

Manifest parse_manifest(std::string_view text, const std::string& file) {
  uint64_t written = 0;
  if (!text.starts_with(first_word)) damaged(file, "doesn't begin as the manifest of a cache does");
  Words words(text.substr(first_word.size(), text.find('\n') - std::min(text.find('\n'), first_word.size())));
  if (!words.number(written) || written == 0) damaged(file, "names no version");
  if (written > version)
    throw Error(ErrorKind::failed_precondition, "CACHE_TOO_NEW",
                file + ": written by a newer version of Fogbank (format " + std::to_string(written) +
                    "; this one reads up to " + std::to_string(version) + ")");
  const size_t end = text.rfind("checksum ");
  if (end == std::string_view::npos || text.substr(end) != "checksum " + checksum(text.substr(0, end)) + "\n")
    damaged(file, "its checksum is wrong");

  Manifest manifest;
  std::string_view lines = text.substr(0, end);
  lines.remove_prefix(lines.find('\n') + 1);
  while (!lines.empty()) {
    Words line(lines.substr(0, lines.find('\n')));
    lines.remove_prefix(std::min(lines.find('\n'), lines.size() - 1) + 1);
    const std::string_view key = line.take();
    bool good = false;
    if (key == "transport") {
      manifest.transport = line.take();
      good = is_sha256(manifest.transport);
    } else if (key == "epoch") {
      good = line.number(manifest.epoch);
    } else if (key == "segment") {
      SegmentEntry& segment = manifest.segments.emplace_back();
      segment.sha256 = line.take();
      good = is_sha256(segment.sha256) && line.number(segment.bytes) && line.number(segment.records) &&
             line.number(segment.epoch) && line.number(segment.sealed_at);
    }
    if (!good || !line.empty()) damaged(file, "a line makes no sense");
  }
  if (manifest.transport.empty()) damaged(file, "names no scene");
  return manifest;
}

}  // namespace fogbank::cache
