// Caches on disk: a folder for each radiance field, named by its transport fingerprint, with
//
//   lock                    held (flock) while anything below is changed; its date is that of the last use
//   manifest                the list of segments (manifest.h), written last
//   segments/<SHA-256>      sealed sets of records (segment.h); immutable
//   quarantine/<SHA-256>    damaged files, moved here and never read again
//
// A file appears under its name when it is whole and on the disk, and the manifest names it only then. So a
// crash leaves at worst a whole segment that isn't named: the next to load adopts it, as it does all of them
// if the manifest is lost. Any number of processes may use a folder at once: each change is made under the
// lock to what is there then. Network file systems without flock aren't supported.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cache/record_set.h"
#include "cache/store/manifest.h"
#include "cache/store/segment.h"
#include "scene/field_identity.h"

namespace fogbank::scene {
struct Scene;
}

namespace fogbank::cache {

/// What the records of jobs with `max_depth` (IntegratorSettings) depend on in `scene`: paths of limited
/// length make another light field.
scene::FieldIdentity record_field(const scene::Scene& scene, int32_t max_depth);

/// A file that can't be used.
struct Damage {
  std::string file;    ///< path below the cache's folder
  std::string reason;  ///< begins with the file's name
  bool quarantined =
      false;  ///< moved aside; if not, it is of a newer version, or the folder can't be written
};

struct LoadedRecords {
  RecordSet records;
  uint64_t bytes = 0;              ///< read
  uint64_t epoch = 0;              ///< of the manifest
  std::vector<Damage> damages;     ///< cost time, never correctness
  std::vector<std::string> notes;  ///< what became of records of other emissions, in sentences
};

/// A cache as `ls` and `show` tell it. Dates are seconds since 1970.
struct CacheSummary {
  std::string transport;  ///< 64 hexadecimal digits
  uint64_t epoch = 0;
  uint64_t records = 0;  ///< of all segments; one that is in several counts in each
  uint64_t bytes = 0;    ///< of segments
  int64_t changed_at = 0;
  int64_t used_at = 0;
  std::vector<ComponentCount> components;  ///< ascending
  std::vector<SegmentEntry> segments;
  uint64_t quarantined_files = 0;
  uint64_t quarantined_bytes = 0;
  std::vector<Damage> damages;  ///< seen without reading more than headers
};

/// What verify() found out about a segment.
struct SegmentReport {
  SegmentEntry segment;
  std::optional<Damage> damage;
};

struct VerifyReport {
  std::vector<SegmentReport> segments;
  std::vector<Damage> other_damages;  ///< of the manifest, of missing segments
};

/// What an export file or a merge of some holds.
struct TransferReport {
  std::string transport;
  uint64_t records = 0;
  uint64_t bytes = 0;  ///< of the file
  uint64_t epoch = 0;  ///< of the cache, after an import
  std::vector<ComponentCount> components;
  std::vector<Damage> damages;  ///< of the cache: their records aren't in the export
};

struct GarbageReport {
  std::vector<std::string> removed;  ///< fingerprints of caches, least recently used first
  uint64_t bytes_freed = 0;
  uint64_t bytes_left = 0;
};

/// One folder, as above. Thread-safe. Errors of files are Error with DISK_FULL or STORAGE_ERROR
/// (core/files.h); the folder is as it was then.
class StoredCache {
 public:
  /// Nothing is touched yet.
  StoredCache(std::filesystem::path folder, std::string transport);

  const std::string& transport() const { return transport_; }
  const std::filesystem::path& folder() const { return folder_; }

  /// All that says something about a scene with `emission`. Damaged files are quarantined and reported.
  /// Throws only when the folder as a whole can't be read, and Error(failed_precondition, "CACHE_TOO_NEW")
  /// for the manifest of a newer version, which is left alone.
  LoadedRecords load(const std::vector<Spectrum>& emission);
  /// Seals the records, made under `emission`, as a segment, and returns the epoch that names it. Small
  /// segments are united now and then, so that there are few.
  uint64_t append(const RecordSet& records, const std::vector<Spectrum>& emission);

  CacheSummary describe();
  /// Reads every byte; quarantines what is damaged.
  VerifyReport verify();
  /// Unites all segments in as few as there may be.
  void compact();

  /// All records, of all emissions, as one file: a segment (segment.h). The same records give the same bytes.
  TransferReport export_to(const std::filesystem::path& file);
  /// Union with the file's records. Throws Error(failed_precondition, "CACHE_MISMATCH") naming both
  /// fingerprints if they are of another field, and as open_segment(); nothing is changed then.
  TransferReport import_from(const std::filesystem::path& file);

  /// The folder and all that is in it are gone.
  void remove();

 private:
  class Lock;
  /// What is on the disk, as far as it is in order.
  struct Contents {
    Manifest manifest;
    bool changed = false;  ///< the manifest on the disk says something else
    std::vector<Damage> damages;
  };

  std::filesystem::path manifest_path() const { return folder_ / "manifest"; }
  std::filesystem::path segment_path(const std::string& sha256) const {
    return folder_ / "segments" / sha256;
  }
  Contents read_contents(const Lock& lock) const;
  void read_manifest(const Lock& lock, Contents& contents) const;
  void compare_with_files(const Lock& lock, Contents& contents) const;
  /// Reports a file, and moves it aside if `lock` allows it.
  void set_aside(const Lock& lock, const std::filesystem::path& file, const std::string& reason,
                 Contents& contents) const;
  /// A segment that is what its name says; nullopt where it isn't, which is reported then.
  std::optional<Segment> read_segment(const Lock& lock, const SegmentEntry& entry, Contents& contents) const;
  /// All that the manifest names, united.
  std::vector<SegmentPart> read_parts(const Lock& lock, Contents& contents) const;
  std::vector<SegmentPart> read_parts(const Lock& lock, const std::vector<SegmentEntry>& entries,
                                      Contents& contents, std::vector<SegmentEntry>* read) const;
  uint64_t add_segment(const SealedSegment& sealed);
  void write_segment(const SealedSegment& sealed, Contents& contents) const;
  /// Replaces those of `entries` that can be read by one that holds all they do; false if there are not two.
  bool unite_segments(const Lock& lock, const std::vector<SegmentEntry>& entries, Contents& contents) const;
  void write_manifest(Contents& contents) const;

  std::filesystem::path folder_;
  std::string transport_;
};

/// All caches of a server. Thread-safe.
class Store {
 public:
  /// `folder` is made when something is stored.
  explicit Store(std::filesystem::path folder);

  /// Never null; the cache may be empty yet.
  std::shared_ptr<StoredCache> cache(const std::string& transport);
  /// Caches that exist, by fingerprint.
  std::vector<std::string> list() const;
  /// Throws Error(not_found, "CACHE_NOT_FOUND").
  std::shared_ptr<StoredCache> existing(const std::string& transport);
  /// Imports a file into the cache that it names.
  TransferReport import_from(const std::filesystem::path& file);
  /// Throws as existing().
  void remove(const std::string& transport);
  /// Unites the segments of each cache, then removes quarantined files and whole caches, least recently used
  /// first, until all caches together take `budget` bytes at most; those of `in_use` stay.
  GarbageReport collect_garbage(uint64_t budget, const std::set<std::string>& in_use);

 private:
  std::filesystem::path folder_;
};

/// Union of exported files. Throws as StoredCache::import_from.
TransferReport merge_exports(const std::vector<std::filesystem::path>& inputs,
                             const std::filesystem::path& output);
/// What an exported file holds. Throws as open_segment().
TransferReport describe_export(const std::filesystem::path& file);

}  // namespace fogbank::cache
