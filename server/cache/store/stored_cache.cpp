#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <chrono>
#include <limits>
#include <map>
#include <utility>

#include "cache/store/emission.h"
#include "cache/store/store.h"
#include "core/error.h"
#include "core/failpoint.h"
#include "core/files.h"

namespace fogbank::cache {
namespace {

namespace fs = std::filesystem;

/// Segments of about the same number of records, by powers of four, that are united to one: each record is
/// written once for each power that the cache grows by.
constexpr size_t most_alike = 4;
/// No segment gets larger by that: bounds the memory that uniting takes, to some 2 GB.
constexpr uint64_t most_united_records = uint64_t{1} << 21;
constexpr int64_t most_manifest_bytes = int64_t{1} << 26;
constexpr int64_t most_file_bytes = std::numeric_limits<int64_t>::max();

int64_t now() {
  return std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

int64_t date_of(const fs::path& file) {
  struct stat status {};
  return ::stat(file.c_str(), &status) == 0 ? status.st_mtim.tv_sec : 0;
}

uint64_t size_of(const fs::path& file) {
  std::error_code error;
  const uintmax_t size = fs::file_size(file, error);
  return error ? 0 : size;
}

std::vector<fs::path> files_in(const fs::path& folder) {
  std::vector<fs::path> result;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error); !error && entry != fs::directory_iterator();
       entry.increment(error))
    result.push_back(entry->path());
  std::ranges::sort(result);
  return result;
}

SegmentInfo read_info(const fs::path& file) {
  const uint64_t size = size_of(file);
  // The header says how long it is in its first 16 bytes.
  std::string bytes = read_range(file, 0, 16);
  if (bytes.size() == 16) {
    uint32_t header = 0;
    bytes.copy(reinterpret_cast<char*>(&header), sizeof(header), 12);
    bytes = read_range(file, 0, static_cast<int64_t>(std::min<uint64_t>(header, size)));
  }
  return read_segment_info(bytes, size, file.filename().string());
}

void add(std::vector<ComponentCount>& sum, const std::vector<ComponentCount>& counts) {
  for (const ComponentCount& count : counts) {
    const auto at = std::ranges::lower_bound(sum, count.component, {}, &ComponentCount::component);
    if (at != sum.end() && at->component == count.component)
      at->records += count.records;
    else
      sum.insert(at, count);
  }
}

}  // namespace

/// The right to read what is there (shared) or to change it. Reading goes on without where nothing can be
/// locked: what is read proves itself.
class StoredCache::Lock {
 public:
  enum class Kind : uint8_t { shared, exclusive };

  Lock(const fs::path& folder, Kind kind) {
    if (kind == Kind::exclusive) {
      std::error_code error;
      if (fs::create_directories(folder / "segments", error)) {
        // Its name, that of the cache and that of the store last.
        for (const fs::path& changed : {folder, folder.parent_path(), folder.parent_path().parent_path()})
          sync_folder(changed);
      }
      if (error) error_ = error.value();
    }
    while (error_ == 0) {
      const int flags = (kind == Kind::exclusive ? O_RDWR | O_CREAT : O_RDONLY) | O_CLOEXEC;
      descriptor_ = FileDescriptor(::open((folder / "lock").c_str(), flags, 0600));
      if (!descriptor_.valid()) {
        error_ = errno;
        break;
      }
      while (::flock(descriptor_.get(), kind == Kind::exclusive ? LOCK_EX : LOCK_SH) != 0)
        if (errno != EINTR) {
          error_ = errno;
          break;
        }
      // Who waited for the one that removed the folder holds a file without a name.
      struct stat status {};
      if (error_ != 0 || ::fstat(descriptor_.get(), &status) != 0 || status.st_nlink > 0) break;
      if (kind == Kind::exclusive) fs::create_directories(folder / "segments");
    }
    writable_ = kind == Kind::exclusive && error_ == 0;
    if (writable_) ::futimens(descriptor_.get(), nullptr);
  }

  bool writable() const { return writable_; }
  /// Throws unless writable.
  void require(const fs::path& folder) const {
    if (!writable_) throw_file_error(error_, "writing to the cache in", folder);
  }

 private:
  FileDescriptor descriptor_;
  int error_ = 0;
  bool writable_ = false;
};

StoredCache::StoredCache(fs::path folder, std::string transport)
    : folder_(std::move(folder)), transport_(std::move(transport)) {}

void StoredCache::set_aside(const Lock& lock, const fs::path& file, const std::string& reason,
                            Contents& contents) const {
  Damage damage{file.lexically_relative(folder_).string(), reason, false};
  if (lock.writable()) {
    std::error_code error;
    fs::create_directories(folder_ / "quarantine", error);
    fs::path target = folder_ / "quarantine" / file.filename();
    for (int copy = 1; fs::exists(target, error); ++copy)
      target = folder_ / "quarantine" / (file.filename().string() + "." + std::to_string(copy));
    fs::rename(file, target, error);
    damage.quarantined = !error;
  }
  contents.damages.push_back(std::move(damage));
}

void StoredCache::read_manifest(const Lock& lock, Contents& contents) const {
  contents.manifest.transport = transport_;
  if (!fs::exists(manifest_path())) return;
  try {
    Manifest manifest = parse_manifest(read_file(manifest_path(), most_manifest_bytes), "manifest");
    if (manifest.transport != transport_)
      throw Error(ErrorKind::data_loss, "MANIFEST_DAMAGED",
                  "manifest: of the cache " + manifest.transport + " instead of " + transport_);
    contents.manifest = std::move(manifest);
  } catch (const Error& error) {
    if (error.kind() != ErrorKind::data_loss) throw;
    set_aside(lock, manifest_path(), error.what(), contents);
    contents.changed = true;
  }
}

void StoredCache::compare_with_files(const Lock& lock, Contents& contents) const {
  Manifest& manifest = contents.manifest;
  const size_t before = manifest.segments.size();
  std::erase_if(manifest.segments, [&](const SegmentEntry& entry) {
    if (fs::exists(segment_path(entry.sha256))) return false;
    contents.damages.push_back({"segments/" + entry.sha256, entry.sha256 + ": is missing", false});
    return true;
  });
  contents.changed = contents.changed || manifest.segments.size() != before;
  std::vector<SegmentEntry> adopted;
  for (const fs::path& file : files_in(folder_ / "segments")) {
    const std::string name = file.filename().string();
    if (manifest.names(name)) continue;
    if (!is_sha256(name)) {
      // What a crash left half written.
      std::error_code error;
      if (lock.writable() && name.ends_with(".tmp")) fs::remove(file, error);
      continue;
    }
    try {
      const SegmentInfo info = read_info(file);
      adopted.push_back({name, size_of(file), info.records, manifest.epoch + 1, date_of(file)});
    } catch (const Error& error) {
      if (error.kind() == ErrorKind::data_loss)
        set_aside(lock, file, error.what(), contents);
      else
        contents.damages.push_back({"segments/" + name, error.what(), false});
    }
  }
  if (adopted.empty()) return;
  manifest.segments.insert(manifest.segments.end(), adopted.begin(), adopted.end());
  ++manifest.epoch;
  contents.changed = true;
}

StoredCache::Contents StoredCache::read_contents(const Lock& lock) const {
  Contents contents;
  read_manifest(lock, contents);
  compare_with_files(lock, contents);
  return contents;
}

std::optional<Segment> StoredCache::read_segment(const Lock& lock, const SegmentEntry& entry,
                                                 Contents& contents) const {
  const fs::path file = segment_path(entry.sha256);
  try {
    Segment segment = open_segment(read_file(file, most_file_bytes), entry.sha256);
    if (segment.sha256 != entry.sha256)
      throw Error(ErrorKind::data_loss, "SEGMENT_DAMAGED",
                  entry.sha256 + ": holds another segment, " + segment.sha256);
    if (segment.info.transport != transport_)
      throw Error(ErrorKind::data_loss, "SEGMENT_DAMAGED",
                  entry.sha256 + ": of the cache " + segment.info.transport + " instead of " + transport_);
    return segment;
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::data_loss) {
      set_aside(lock, file, error.what(), contents);
      std::erase_if(contents.manifest.segments,
                    [&](const SegmentEntry& other) { return other.sha256 == entry.sha256; });
      contents.changed = true;
    } else {
      contents.damages.push_back({"segments/" + entry.sha256, error.what(), false});
    }
    return std::nullopt;
  }
}

std::vector<SegmentPart> StoredCache::read_parts(const Lock& lock, const std::vector<SegmentEntry>& entries,
                                                 Contents& contents, std::vector<SegmentEntry>* read) const {
  // Small ones first: unions are linear in the sizes.
  std::vector<SegmentEntry> order = entries;
  std::ranges::stable_sort(order, {}, &SegmentEntry::records);
  std::vector<SegmentPart> parts;
  for (const SegmentEntry& entry : order)
    if (std::optional<Segment> segment = read_segment(lock, entry, contents)) {
      parts = unite(std::move(parts), std::move(segment->parts));
      if (read != nullptr) read->push_back(entry);
    }
  return parts;
}

LoadedRecords StoredCache::load(const std::vector<Spectrum>& emission) {
  // Others may read at the same time unless something is to be set right.
  for (const Lock::Kind kind : {Lock::Kind::shared, Lock::Kind::exclusive}) {
    if (!fs::exists(folder_)) break;
    const Lock lock(folder_, kind);
    Contents contents = read_contents(lock);
    LoadedRecords loaded;
    for (const SegmentEntry& entry : contents.manifest.segments) loaded.bytes += entry.bytes;
    std::vector<SegmentPart> parts = read_parts(lock, contents.manifest.segments, contents, nullptr);
    if (kind == Lock::Kind::shared && (contents.changed || !contents.damages.empty())) continue;
    if (contents.changed && lock.writable()) {
      try {
        write_manifest(contents);
      } catch (const Error& error) {
        contents.damages.push_back({"manifest", error.what(), false});
      }
    }
    loaded.epoch = contents.manifest.epoch;
    loaded.damages = std::move(contents.damages);
    loaded.records = usable_records(std::move(parts), emission, loaded.notes);
    return loaded;
  }
  return {};
}

uint64_t StoredCache::append(const RecordSet& records, const std::vector<Spectrum>& emission) {
  return add_segment(seal_segment(transport_, parts_of(emission, records)));
}

uint64_t StoredCache::add_segment(const SealedSegment& sealed) {
  const Lock lock(folder_, Lock::Kind::exclusive);
  lock.require(folder_);
  Contents contents = read_contents(lock);
  if (sealed.records > 0 && !contents.manifest.names(sealed.sha256)) {
    write_segment(sealed, contents);
    write_manifest(contents);
  }
  for (bool again = true; again;) {
    again = false;
    std::map<int, std::vector<SegmentEntry>> alike;
    for (const SegmentEntry& entry : contents.manifest.segments)
      alike[std::bit_width(entry.records) / 2].push_back(entry);
    for (const auto& [power, entries] : alike) {
      if (entries.size() < most_alike || uint64_t{1} << 2 * power > most_united_records / most_alike)
        continue;
      again = unite_segments(lock, entries, contents);
      break;
    }
  }
  if (contents.changed) write_manifest(contents);
  return contents.manifest.epoch;
}

void StoredCache::write_segment(const SealedSegment& sealed, Contents& contents) const {
  FOGBANK_FAILPOINT("cache.before_segment");
  write_file_durably(segment_path(sealed.sha256), sealed.bytes);
  FOGBANK_FAILPOINT("cache.after_segment");
  contents.manifest.segments.push_back(
      {sealed.sha256, sealed.bytes.size(), sealed.records, ++contents.manifest.epoch, now()});
  contents.changed = true;
}

bool StoredCache::unite_segments(const Lock& lock, const std::vector<SegmentEntry>& entries,
                                 Contents& contents) const {
  std::vector<SegmentEntry> read;
  std::vector<SegmentPart> parts = read_parts(lock, entries, contents, &read);
  if (read.size() < 2) return false;
  const SealedSegment sealed = seal_segment(transport_, parts);
  if (!contents.manifest.names(sealed.sha256)) write_segment(sealed, contents);
  std::erase_if(read, [&](const SegmentEntry& entry) { return entry.sha256 == sealed.sha256; });
  std::erase_if(contents.manifest.segments, [&](const SegmentEntry& entry) {
    return std::ranges::find(read, entry.sha256, &SegmentEntry::sha256) != read.end();
  });
  contents.changed = true;
  write_manifest(contents);
  FOGBANK_FAILPOINT("cache.before_unlink");
  std::error_code error;
  for (const SegmentEntry& entry : read) fs::remove(segment_path(entry.sha256), error);
  return true;
}

void StoredCache::write_manifest(Contents& contents) const {
  FOGBANK_FAILPOINT("cache.before_manifest");
  write_file_durably(manifest_path(), to_text(contents.manifest));
  FOGBANK_FAILPOINT("cache.after_manifest");
  contents.changed = false;
}

void StoredCache::compact() {
  const Lock lock(folder_, Lock::Kind::exclusive);
  lock.require(folder_);
  Contents contents = read_contents(lock);
  std::vector<SegmentEntry> order = contents.manifest.segments;
  std::ranges::stable_sort(order, {}, &SegmentEntry::records);
  std::vector<SegmentEntry> group;
  uint64_t records = 0;
  const auto unite_group = [&] {
    if (group.size() > 1) unite_segments(lock, group, contents);
    group.clear();
    records = 0;
  };
  for (const SegmentEntry& entry : order) {
    if (records + entry.records > most_united_records) unite_group();
    group.push_back(entry);
    records += entry.records;
  }
  unite_group();
  if (contents.changed) write_manifest(contents);
}

CacheSummary StoredCache::describe() {
  CacheSummary summary;
  summary.transport = transport_;
  if (!fs::exists(folder_)) return summary;
  const Lock lock(folder_, Lock::Kind::shared);
  Contents contents = read_contents(lock);
  summary.epoch = contents.manifest.epoch;
  summary.changed_at = date_of(manifest_path());
  summary.used_at = date_of(folder_ / "lock");
  for (const SegmentEntry& entry : contents.manifest.segments) {
    try {
      const SegmentInfo info = read_info(segment_path(entry.sha256));
      add(summary.components, info.components);
      summary.records += info.records;
    } catch (const Error& error) {
      contents.damages.push_back({"segments/" + entry.sha256, error.what(), false});
    }
    summary.bytes += size_of(segment_path(entry.sha256));
    summary.segments.push_back(entry);
  }
  for (const fs::path& file : files_in(folder_ / "quarantine")) {
    ++summary.quarantined_files;
    summary.quarantined_bytes += size_of(file);
  }
  summary.damages = std::move(contents.damages);
  return summary;
}

VerifyReport StoredCache::verify() {
  VerifyReport report;
  if (!fs::exists(folder_)) return report;
  const Lock lock(folder_, Lock::Kind::exclusive);
  Contents contents = read_contents(lock);
  report.other_damages = std::exchange(contents.damages, {});
  for (const SegmentEntry& entry : std::vector(contents.manifest.segments)) {
    SegmentReport& segment = report.segments.emplace_back();
    segment.segment = entry;
    if (!read_segment(lock, entry, contents)) segment.damage = contents.damages.back();
  }
  if (contents.changed && lock.writable()) write_manifest(contents);
  return report;
}

TransferReport StoredCache::export_to(const fs::path& file) {
  const Lock lock(folder_, Lock::Kind::shared);
  Contents contents = read_contents(lock);
  const SealedSegment sealed =
      seal_segment(transport_, read_parts(lock, contents.manifest.segments, contents, nullptr));
  FOGBANK_FAILPOINT("cache.before_export");
  write_file_durably(file, sealed.bytes);
  TransferReport report = describe_export(file);
  report.epoch = contents.manifest.epoch;
  report.damages = std::move(contents.damages);
  return report;
}

TransferReport StoredCache::import_from(const fs::path& file) {
  SealedSegment sealed;
  sealed.bytes = read_file(file, most_file_bytes);
  const Segment segment = open_segment(sealed.bytes, file.filename().string());
  if (segment.info.transport != transport_)
    throw Error(
        ErrorKind::failed_precondition, "CACHE_MISMATCH",
        file.filename().string() + ": holds the cache " + segment.info.transport + ", not " + transport_);
  sealed.sha256 = segment.sha256;
  sealed.records = segment.info.records;
  TransferReport report{transport_, sealed.records, sealed.bytes.size(), 0, segment.info.components, {}};
  report.epoch = add_segment(sealed);
  return report;
}

void StoredCache::remove() {
  const Lock lock(folder_, Lock::Kind::exclusive);
  lock.require(folder_);
  // Gone at once for all others; a crash leaves only what no one looks for.
  fs::path removed = folder_;
  removed += ".removed." + std::to_string(::getpid());
  FOGBANK_FAILPOINT("cache.before_remove");
  rename_durably(folder_, removed);
  FOGBANK_FAILPOINT("cache.after_remove");
  std::error_code error;
  fs::remove_all(removed, error);
}

TransferReport describe_export(const fs::path& file) {
  const SegmentInfo info = read_info(file);
  return {info.transport, info.records, size_of(file), 0, info.components, {}};
}

TransferReport merge_exports(const std::vector<fs::path>& inputs, const fs::path& output) {
  std::vector<SegmentPart> parts;
  std::string transport;
  std::string first;
  for (const fs::path& input : inputs) {
    const std::string name = input.filename().string();
    Segment segment = open_segment(read_file(input, most_file_bytes), name);
    if (transport.empty()) {
      transport = segment.info.transport;
      first = name;
    }
    if (segment.info.transport != transport)
      throw Error(ErrorKind::failed_precondition, "CACHE_MISMATCH",
                  std::string(name)
                      .append(": holds the cache ")
                      .append(segment.info.transport)
                      .append(", but ")
                      .append(first)
                      .append(" holds ")
                      .append(transport));
    parts = unite(std::move(parts), std::move(segment.parts));
  }
  if (inputs.empty()) throw Error(ErrorKind::invalid_argument, "NO_EXPORTS", "there are no files to merge");
  write_file_durably(output, seal_segment(transport, parts).bytes);
  return describe_export(output);
}

}  // namespace fogbank::cache
