#include "cache/store/store.h"

#include <algorithm>

#include "core/error.h"
#include "core/files.h"
#include "core/sha256.h"
#include "scene/scene.h"

namespace fogbank::cache {

namespace fs = std::filesystem;

scene::FieldIdentity record_field(const scene::Scene& scene, int32_t max_depth) {
  scene::FieldIdentity field = scene.field;
  if (max_depth >= 0) field.transport = sha256(field.transport + " max_depth " + std::to_string(max_depth));
  return field;
}

Store::Store(fs::path folder) : folder_(std::move(folder)) {}

std::shared_ptr<StoredCache> Store::cache(const std::string& transport) {
  return std::make_shared<StoredCache>(folder_ / transport, transport);
}

std::vector<std::string> Store::list() const {
  std::vector<std::string> result;
  std::error_code error;
  for (fs::directory_iterator entry(folder_, error); !error && entry != fs::directory_iterator();
       entry.increment(error))
    if (std::string name = entry->path().filename().string(); is_sha256(name))
      result.push_back(std::move(name));
  std::ranges::sort(result);
  return result;
}

std::shared_ptr<StoredCache> Store::existing(const std::string& transport) {
  if (!is_sha256(transport) || !fs::exists(folder_ / transport))
    throw Error(ErrorKind::not_found, "CACHE_NOT_FOUND", "there is no cache " + transport);
  return cache(transport);
}

TransferReport Store::import_from(const fs::path& file) {
  return cache(describe_export(file).transport)->import_from(file);
}

void Store::remove(const std::string& transport) { existing(transport)->remove(); }

GarbageReport Store::collect_garbage(uint64_t budget, const std::set<std::string>& in_use) {
  struct Candidate {
    CacheSummary summary;
    uint64_t bytes;
  };
  GarbageReport report;
  std::error_code error;
  // What a crash left of caches that were removed.
  std::vector<fs::path> removed;
  for (fs::directory_iterator entry(folder_, error); !error && entry != fs::directory_iterator();
       entry.increment(error))
    if (entry->path().filename().string().find(".removed.") != std::string::npos)
      removed.push_back(entry->path());
  for (const fs::path& folder : removed) fs::remove_all(folder, error);

  std::vector<Candidate> candidates;
  for (const std::string& transport : list()) {
    const std::shared_ptr<StoredCache> stored = cache(transport);
    Candidate candidate{stored->describe(), 0};
    const uint64_t before = candidate.summary.bytes;
    if (candidate.summary.segments.size() > 1) {
      stored->compact();
      const int64_t used_at = candidate.summary.used_at;  // tidying up is no use
      candidate.summary = stored->describe();
      candidate.summary.used_at = used_at;
      report.bytes_freed += before - std::min(before, candidate.summary.bytes);
    }
    candidate.bytes = candidate.summary.bytes + candidate.summary.quarantined_bytes;
    report.bytes_left += candidate.bytes;
    candidates.push_back(std::move(candidate));
  }
  std::ranges::stable_sort(candidates, {}, [](const Candidate& c) { return c.summary.used_at; });
  const auto free = [&](uint64_t bytes) {
    report.bytes_freed += bytes;
    report.bytes_left -= bytes;
  };
  for (Candidate& candidate : candidates) {
    if (report.bytes_left <= budget) break;
    if (candidate.summary.quarantined_files == 0) continue;
    fs::remove_all(folder_ / candidate.summary.transport / "quarantine", error);
    free(candidate.summary.quarantined_bytes);
    candidate.bytes = candidate.summary.bytes;
  }
  for (const Candidate& candidate : candidates) {
    if (report.bytes_left <= budget) break;
    if (in_use.contains(candidate.summary.transport)) continue;
    remove(candidate.summary.transport);
    report.removed.push_back(candidate.summary.transport);
    free(candidate.bytes);
  }
  return report;
}

}  // namespace fogbank::cache
