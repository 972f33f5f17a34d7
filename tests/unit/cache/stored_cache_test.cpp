#include <gtest/gtest.h>
#include <sys/resource.h>

#include <csignal>
#include <fstream>
#include <thread>

#include "cache/store/store.h"
#include "core/error.h"
#include "core/files.h"
#include "core/sha256.h"
#include "temporary_folder.h"
#include "varied_records.h"

namespace fogbank::cache {
namespace {

namespace fs = std::filesystem;
using test::same;
using test::TemporaryFolder;
using test::varied_records;

const std::string transport = sha256("a scene");
const std::vector<Spectrum> emission{Spectrum(1)};

RecordSet part(const std::vector<Record>& records, size_t first, size_t last) {
  return RecordSet(std::vector<Record>(records.begin() + static_cast<std::ptrdiff_t>(first),
                                       records.begin() + static_cast<std::ptrdiff_t>(last)));
}

class StoredCacheTest : public ::testing::Test {
 protected:
  StoredCacheTest() : stored_(folder_.path() / transport, transport), records_(varied_records(300, 1)) {}

  /// Three segments, of records 0 to 100, 100 to 250 and 250 to 300.
  void fill() {
    stored_.append(part(records_, 0, 100), emission);
    stored_.append(part(records_, 100, 250), emission);
    stored_.append(part(records_, 250, 300), emission);
  }
  fs::path segment(size_t number) const {
    return stored_.folder() / "segments" /
           parse_manifest(text(stored_.folder() / "manifest"), "manifest").segments[number].sha256;
  }
  static std::string text(const fs::path& file) { return read_file(file, 1 << 30); }
  static void write(const fs::path& file, const std::string& bytes) {
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
  }
  LoadedRecords load() { return stored_.load(emission); }
  /// One file is damaged, found, and gone for good; all else is there.
  void expect_quarantined(const std::string& name, const RecordSet& left) {
    const LoadedRecords loaded = load();
    ASSERT_EQ(loaded.damages.size(), 1u);
    EXPECT_TRUE(loaded.damages[0].quarantined);
    EXPECT_NE(loaded.damages[0].file.find(name), std::string::npos);
    EXPECT_TRUE(loaded.damages[0].reason.starts_with(name)) << loaded.damages[0].reason;
    EXPECT_TRUE(same(loaded.records, left));
    EXPECT_TRUE(fs::exists(stored_.folder() / "quarantine" / name));
    const LoadedRecords again = load();
    EXPECT_TRUE(again.damages.empty());
    EXPECT_TRUE(same(again.records, left));
  }

  TemporaryFolder folder_;
  StoredCache stored_;
  std::vector<Record> records_;
};

TEST_F(StoredCacheTest, NothingIsThereAtFirst) {
  EXPECT_EQ(load().records.size(), 0u);
  EXPECT_EQ(stored_.describe().records, 0u);
  EXPECT_TRUE(stored_.verify().segments.empty());
  EXPECT_FALSE(fs::exists(stored_.folder())) << "reading makes no folder";
}

TEST_F(StoredCacheTest, KeepsWhatWasAppended) {
  fill();
  StoredCache other(stored_.folder(), transport);
  const LoadedRecords loaded = other.load(emission);
  EXPECT_TRUE(same(loaded.records, RecordSet(records_)));
  EXPECT_TRUE(loaded.damages.empty());
  EXPECT_TRUE(loaded.notes.empty());
  EXPECT_EQ(loaded.epoch, 3u);
  const CacheSummary summary = other.describe();
  EXPECT_EQ(summary.records, records_.size());
  EXPECT_EQ(summary.segments.size(), 3u);
  EXPECT_EQ(summary.epoch, 3u);
}

TEST_F(StoredCacheTest, AppendingTheSameAgainChangesNothing) {
  fill();
  EXPECT_EQ(stored_.append(part(records_, 100, 250), emission), 3u);
  EXPECT_EQ(stored_.describe().segments.size(), 3u);
  EXPECT_EQ(stored_.append(RecordSet(), emission), 3u);
}

TEST_F(StoredCacheTest, SmallSegmentsAreUnited) {
  for (size_t i = 0; i < 60; ++i) stored_.append(part(records_, 5 * i, 5 * i + 5), emission);
  const CacheSummary summary = stored_.describe();
  EXPECT_LT(summary.segments.size(), 12u);
  EXPECT_EQ(summary.records, records_.size());
  EXPECT_TRUE(same(load().records, RecordSet(records_)));
  size_t files = 0;
  for ([[maybe_unused]] const auto& file : fs::directory_iterator(stored_.folder() / "segments")) ++files;
  EXPECT_EQ(files, summary.segments.size());
  stored_.compact();
  EXPECT_EQ(stored_.describe().segments.size(), 1u);
  EXPECT_TRUE(same(load().records, RecordSet(records_)));
}

TEST_F(StoredCacheTest, DamagedSegmentsAreQuarantined) {
  const auto damages = std::to_array<void (*)(std::string&)>({
      [](std::string& bytes) { bytes.clear(); },
      [](std::string& bytes) { bytes.resize(7); },
      [](std::string& bytes) { bytes.resize(bytes.size() - 1); },
      [](std::string& bytes) { bytes.resize(bytes.size() / 2); },
      [](std::string& bytes) { bytes += "more"; },
      [](std::string& bytes) { bytes[0] = 'f'; },
      [](std::string& bytes) { bytes[20] ^= 1; },
      [](std::string& bytes) { bytes[bytes.size() / 2] ^= 16; },
      [](std::string& bytes) { bytes[bytes.size() - 20] ^= 1; },
      [](std::string& bytes) { bytes.replace(300, 200, 200, '\0'); },
  });
  for (const auto& damage : damages) {
    stored_.append(part(records_, 0, 100), emission);
    stored_.append(part(records_, 100, 250), emission);
    const fs::path file = segment(1);
    std::string bytes = text(file);
    damage(bytes);
    write(file, bytes);
    expect_quarantined(file.filename().string(), part(records_, 0, 100));
    stored_.remove();
  }
}

TEST_F(StoredCacheTest, SegmentUnderAnothersNameIsQuarantined) {
  fill();
  const fs::path first = segment(0);
  const fs::path second = segment(1);
  const std::string bytes = text(first);
  write(first, text(second));
  expect_quarantined(first.filename().string(), part(records_, 100, 300));
  write(first, bytes);  // now it is back
  EXPECT_TRUE(same(load().records, RecordSet(records_)));
}

TEST_F(StoredCacheTest, SegmentOfAnotherSceneIsQuarantined) {
  fill();
  StoredCache other(folder_.path() / sha256("another"), sha256("another"));
  other.append(RecordSet(varied_records(50, 2)), emission);
  const std::string name = other.describe().segments[0].sha256;
  fs::copy_file(other.folder() / "segments" / name, stored_.folder() / "segments" / name);
  const LoadedRecords loaded = load();
  ASSERT_EQ(loaded.damages.size(), 1u);
  EXPECT_TRUE(loaded.damages[0].quarantined);
  EXPECT_NE(loaded.damages[0].reason.find(sha256("another")), std::string::npos);
  EXPECT_TRUE(same(loaded.records, RecordSet(records_)));
}

TEST_F(StoredCacheTest, FolderOfAnotherSceneIsNotRead) {
  fill();
  StoredCache other(folder_.path() / sha256("another"), sha256("another"));
  fs::rename(stored_.folder(), other.folder());
  const LoadedRecords loaded = other.load(emission);
  EXPECT_EQ(loaded.records.size(), 0u);
  EXPECT_EQ(loaded.damages.size(), 4u) << "the manifest and three segments";
}

TEST_F(StoredCacheTest, NewerSegmentsAreLeftAlone) {
  fill();
  const fs::path file = segment(2);
  std::string bytes = text(file);
  bytes[8] = static_cast<char>(segment_version + 1);
  write(file, bytes);
  for (int round = 0; round < 2; ++round) {
    const LoadedRecords loaded = load();
    ASSERT_EQ(loaded.damages.size(), 1u);
    EXPECT_FALSE(loaded.damages[0].quarantined);
    EXPECT_NE(loaded.damages[0].reason.find("newer version"), std::string::npos);
    EXPECT_TRUE(same(loaded.records, part(records_, 0, 250)));
    EXPECT_TRUE(fs::exists(file));
    stored_.append(part(records_, 0, 10 + static_cast<size_t>(round)), emission);
  }
  stored_.compact();
  EXPECT_TRUE(fs::exists(file));
  EXPECT_TRUE(parse_manifest(text(stored_.folder() / "manifest"), "").names(file.filename().string()));
}

TEST_F(StoredCacheTest, NewerManifestIsRefused) {
  fill();
  std::string manifest = text(stored_.folder() / "manifest");
  manifest.replace(0, manifest.find('\n'), "fogbank cache 2");
  write(stored_.folder() / "manifest", manifest);
  try {
    load();
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.reason(), "CACHE_TOO_NEW");
  }
  EXPECT_THROW(stored_.append(part(records_, 0, 1), emission), Error);
  EXPECT_EQ(text(stored_.folder() / "manifest"), manifest);
}

TEST_F(StoredCacheTest, ManifestIsRebuiltFromSegments) {
  fill();
  const std::string manifest = text(stored_.folder() / "manifest");
  fs::remove(stored_.folder() / "manifest");
  EXPECT_TRUE(same(load().records, RecordSet(records_)));
  EXPECT_EQ(stored_.describe().segments.size(), 3u);
  for (size_t at = 0; at < manifest.size(); at += 9) {
    std::string damaged = manifest;
    damaged[at] = static_cast<char>(damaged[at] ^ 1);
    write(stored_.folder() / "manifest", damaged);

    const LoadedRecords loaded = load();
    EXPECT_TRUE(same(loaded.records, RecordSet(records_))) << at;
    ASSERT_EQ(loaded.damages.size(), 1u) << at;
    EXPECT_TRUE(loaded.damages[0].quarantined);
  }
  for (const size_t length : {size_t{0}, size_t{10}, manifest.size() / 2, manifest.size() - 1}) {
    write(stored_.folder() / "manifest", manifest.substr(0, length));
    EXPECT_TRUE(same(load().records, RecordSet(records_))) << length;
  }
}

TEST_F(StoredCacheTest, CrashBeforeTheManifestLosesNothing) {
  fill();
  const std::string manifest = text(stored_.folder() / "manifest");
  const std::vector<Record> more = varied_records(40, 7);
  stored_.append(RecordSet(more), emission);
  write(stored_.folder() / "manifest", manifest);
  write(stored_.folder() / "segments" / (sha256("x") + ".1.1.tmp"), "half writ");
  const LoadedRecords loaded = load();
  EXPECT_TRUE(loaded.damages.empty());
  EXPECT_TRUE(same(loaded.records, merge(RecordSet(records_), RecordSet(more))));
  EXPECT_FALSE(fs::exists(stored_.folder() / "segments" / (sha256("x") + ".1.1.tmp")));
}

TEST_F(StoredCacheTest, MissingSegmentIsReported) {
  fill();
  const fs::path file = segment(0);
  fs::remove(file);
  const LoadedRecords loaded = load();
  ASSERT_EQ(loaded.damages.size(), 1u);
  EXPECT_NE(loaded.damages[0].reason.find("missing"), std::string::npos);
  EXPECT_TRUE(same(loaded.records, part(records_, 100, 300)));
  EXPECT_TRUE(load().damages.empty());
}

TEST_F(StoredCacheTest, VerifyReadsEveryByte) {
  fill();
  EXPECT_EQ(stored_.verify().segments.size(), 3u);
  const fs::path file = segment(1);
  std::string bytes = text(file);
  bytes[bytes.size() / 2] ^= 1;
  write(file, bytes);
  const VerifyReport report = stored_.verify();
  ASSERT_EQ(report.segments.size(), 3u);
  EXPECT_FALSE(report.segments[0].damage);
  ASSERT_TRUE(report.segments[1].damage);
  EXPECT_TRUE(report.segments[1].damage->quarantined);
  EXPECT_FALSE(report.segments[2].damage);
  EXPECT_EQ(stored_.describe().quarantined_files, 1u);
}

TEST_F(StoredCacheTest, FullDiskIsAClearErrorAndHarmsNothing) {
  fill();
  // A limit on file sizes stops writes as a full disk does: part of the file is there already.
  struct sigaction ignore {};
  struct sigaction before {};
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGXFSZ, &ignore, &before);
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit small{1000, limit.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  EXPECT_THROW(stored_.append(RecordSet(varied_records(50, 9)), emission), Error);
  setrlimit(RLIMIT_FSIZE, &limit);
  sigaction(SIGXFSZ, &before, nullptr);
  const LoadedRecords loaded = load();
  EXPECT_TRUE(loaded.damages.empty());
  EXPECT_TRUE(same(loaded.records, RecordSet(records_)));
  EXPECT_EQ(stored_.append(RecordSet(varied_records(50, 9)), emission), 4u);
}

TEST_F(StoredCacheTest, FolderThatCannotBeMadeIsAClearError) {
  write(folder_.path() / "file", "");
  StoredCache nowhere(folder_.path() / "file" / transport, transport);
  EXPECT_EQ(nowhere.load(emission).records.size(), 0u);
  EXPECT_THROW(nowhere.append(RecordSet(records_), emission), Error);
}

TEST_F(StoredCacheTest, TwoWritersAtOnce) {
  const auto write_half = [&](size_t first) {
    StoredCache mine(stored_.folder(), transport);
    for (size_t i = first; i < records_.size(); i += 20) {
      mine.append(part(records_, i, i + 10), emission);
      mine.load(emission);
    }
  };
  std::thread one(write_half, 0);
  std::thread two(write_half, 10);
  one.join();
  two.join();
  const LoadedRecords loaded = load();
  EXPECT_TRUE(loaded.damages.empty());
  EXPECT_TRUE(same(loaded.records, RecordSet(records_)));
}

TEST_F(StoredCacheTest, ExportAndImport) {
  fill();
  const fs::path file = folder_.path() / "export";
  const TransferReport report = stored_.export_to(file);
  EXPECT_EQ(report.records, records_.size());
  EXPECT_EQ(report.transport, transport);
  EXPECT_EQ(report.bytes, fs::file_size(file));
  Store elsewhere(folder_.path() / "elsewhere");
  for (int times = 0; times < 2; ++times) {
    const TransferReport imported = elsewhere.import_from(file);
    EXPECT_EQ(imported.records, records_.size());
    EXPECT_EQ(imported.epoch, 1u);
  }
  EXPECT_TRUE(same(elsewhere.existing(transport)->load(emission).records, RecordSet(records_)));
  elsewhere.existing(transport)->export_to(folder_.path() / "again");
  EXPECT_EQ(text(file), text(folder_.path() / "again"));

  StoredCache other(folder_.path() / sha256("another"), sha256("another"));
  try {
    other.import_from(file);
    FAIL();
  } catch (const Error& error) {
    EXPECT_EQ(error.reason(), "CACHE_MISMATCH");
    EXPECT_NE(std::string(error.what()).find(transport), std::string::npos);
    EXPECT_NE(std::string(error.what()).find(sha256("another")), std::string::npos);
  }
  std::string bytes = text(file);
  bytes[bytes.size() / 2] ^= 1;
  write(file, bytes);
  EXPECT_THROW(elsewhere.import_from(file), Error);
}

TEST_F(StoredCacheTest, MergesOfExportsAreUnions) {
  const auto export_of = [&](const std::string& name, size_t first, size_t last) {
    StoredCache stored(folder_.path() / name, transport);
    stored.append(part(records_, first, last), emission);
    stored.export_to(folder_.path() / (name + ".cache"));
    return folder_.path() / (name + ".cache");
  };
  const fs::path a = export_of("a", 0, 200);
  const fs::path b = export_of("b", 100, 300);
  const fs::path whole = export_of("whole", 0, 300);
  const auto merged = [&](const std::vector<fs::path>& inputs) {
    merge_exports(inputs, folder_.path() / "merged");
    return text(folder_.path() / "merged");
  };
  EXPECT_EQ(merged({a, b}), text(whole));
  EXPECT_EQ(merged({b, a}), text(whole));
  EXPECT_EQ(merged({b, a, a, whole, b}), text(whole));
  EXPECT_EQ(merged({a}), text(a));
}

TEST_F(StoredCacheTest, GarbageGoesByLastUse) {
  Store store(folder_.path() / "caches");
  std::vector<std::string> names;
  for (int i = 0; i < 3; ++i) {
    names.push_back(sha256("scene " + std::to_string(i)));
    store.cache(names.back())
        ->append(RecordSet(varied_records(100, 20 + static_cast<uint64_t>(i))), emission);
    const auto when = fs::file_time_type::clock::now() - std::chrono::hours(10 - (i == 1 ? 9 : i));
    fs::last_write_time(folder_.path() / "caches" / names.back() / "lock", when);
  }
  const uint64_t all = store.collect_garbage(UINT64_MAX, {}).bytes_left;
  EXPECT_EQ(store.list().size(), 3u);
  // Scene 0 is the oldest, but in use; then 2.
  const GarbageReport report = store.collect_garbage(all - 1, {names[0]});
  EXPECT_EQ(report.removed, std::vector{names[2]});
  EXPECT_EQ(report.bytes_left + report.bytes_freed, all);
  EXPECT_THROW(store.existing(names[2]), Error);
  EXPECT_EQ(store.collect_garbage(0, {}).bytes_left, 0u);
  EXPECT_TRUE(store.list().empty());
  EXPECT_THROW(store.remove(names[0]), Error);
  EXPECT_THROW(store.existing("../x"), Error);
}

}  // namespace
}  // namespace fogbank::cache
