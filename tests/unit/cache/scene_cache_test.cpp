#include "cache/scene_cache.h"

#include <gtest/gtest.h>

#include <fstream>

#include "core/error.h"
#include "core/sha256.h"
#include "temporary_folder.h"
#include "varied_records.h"

namespace fogbank::cache {
namespace {

using test::same;
using test::TemporaryFolder;
using test::varied_records;

const scene::FieldIdentity field{sha256("a scene"), {Spectrum(1)}};

class StoredSceneCache : public ::testing::Test {
 protected:
  std::unique_ptr<SceneCache> open() {
    return std::make_unique<SceneCache>(store_.cache(field.transport), field);
  }

  TemporaryFolder folder_;
  Store store_{folder_.path() / "caches"};
};

TEST(SceneCache, GrowsByUnion) {
  SceneCache cache;
  const std::vector<Record> records = varied_records(100, 1);
  const auto before = cache.records();
  cache.add({records.begin(), records.begin() + 60});
  cache.add({records.begin() + 40, records.end()});
  EXPECT_EQ(cache.epoch(), 2u);
  cache.add({records.begin() + 10, records.begin() + 20});
  EXPECT_EQ(cache.epoch(), 2u) << "nothing new";
  EXPECT_TRUE(same(*cache.records(), RecordSet(records)));
  EXPECT_EQ(before->size(), 0u);
  std::vector<Record> bad(2);
  bad[1].samples = 0;
  EXPECT_THROW(cache.add(bad), Error);
  EXPECT_EQ(cache.epoch(), 2u);
  EXPECT_FALSE(cache.storage().stored);
}

TEST_F(StoredSceneCache, SurvivesARestart) {
  const std::vector<Record> records = varied_records(100, 2);
  {
    const auto cache = open();
    for (size_t i = 0; i < 100; i += 10)
      cache->add({records.begin() + static_cast<std::ptrdiff_t>(i),
                  records.begin() + static_cast<std::ptrdiff_t>(i + 10)});
    cache->save();
    EXPECT_EQ(cache->storage().records_unsaved, 0u);
    EXPECT_EQ(cache->storage().problem, "");
    EXPECT_EQ(store_.existing(field.transport)->describe().segments.size(), 1u) << "rounds go together";
  }
  const auto again = open();
  EXPECT_TRUE(same(*again->records(), RecordSet(records)));
  EXPECT_EQ(again->storage().records_loaded, 100u);
}

TEST_F(StoredSceneCache, EndingSaves) {
  const std::vector<Record> records = varied_records(20, 3);
  open()->add(records);
  EXPECT_TRUE(same(*open()->records(), RecordSet(records)));
}

TEST_F(StoredSceneCache, ReloadBringsWhatOthersStored) {
  const auto cache = open();
  const std::vector<Record> records = varied_records(50, 4);
  cache->add({records.begin(), records.begin() + 20});
  store_.cache(field.transport)
      ->append(RecordSet(std::vector<Record>(records.begin() + 10, records.end())), field.emission);
  cache->reload();
  EXPECT_TRUE(same(*cache->records(), RecordSet(records)));
}

TEST_F(StoredSceneCache, GoesOnInMemoryWithoutADisk) {
  std::ofstream(folder_.path() / "caches") << "no folder";
  const std::vector<Record> records = varied_records(50, 5);
  const auto cache = open();
  cache->add(records);
  cache->save();
  EXPECT_NE(cache->storage().problem, "");
  EXPECT_EQ(cache->storage().records_unsaved, 50u);
  EXPECT_TRUE(same(*cache->records(), RecordSet(records)));
  // Once the fault is gone everything is saved.
  std::filesystem::remove(folder_.path() / "caches");
  cache->save();
  EXPECT_EQ(cache->storage().problem, "");
  EXPECT_EQ(cache->storage().records_unsaved, 0u);
  EXPECT_TRUE(same(*open()->records(), RecordSet(records)));
}

}  // namespace
}  // namespace fogbank::cache
