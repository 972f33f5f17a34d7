// Single bits of what the stores hold are turned: faults C6.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <string>

#include "cache/temporary_folder.h"
#include "core/files.h"
#include "core/random.h"
#include "workload.h"

namespace fogbank::faults {
namespace {

namespace fs = std::filesystem;
using cache::test::TemporaryFolder;

int most_flips() {
  const char* const text = std::getenv("FOGBANK_BIT_FLIPS");
  return text == nullptr ? 60 : std::stoi(text);
}

std::vector<fs::path> files_of(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file() && entry.file_size() > 0)
      files.push_back(entry.path().lexically_relative(folder));
  }
  std::ranges::sort(files);
  return files;
}

void flip(const fs::path& file, uint64_t bit) {
  std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(bit / 8));
  const int byte = stream.get();
  stream.seekp(static_cast<std::streamoff>(bit / 8));
  stream.put(static_cast<char>(byte ^ (1 << bit % 8)));
}

TEST(BitFlips, AreFoundOrWithoutEffect) {
  const TemporaryFolder whole;
  Acknowledged acknowledged;
  use_stores(whole.path(), acknowledged);
  ASSERT_EQ(acknowledged.errors, std::vector<std::string>());
  const Contents expected = read_stores(whole.path(), acknowledged);
  ASSERT_EQ(missing(expected, acknowledged), std::vector<std::string>());
  const std::vector<fs::path> files = files_of(whole.path());
  ASSERT_GE(files.size(), 7u);

  int found = 0;
  int harmless = 0;
  for (int trial = 0; trial < most_flips(); ++trial) {
    const TemporaryFolder copy;
    fs::copy(whole.path(), copy.path(), fs::copy_options::recursive);
    // Every file as often as any other, however small it is.
    RandomStream random(1, 0, 0, static_cast<uint32_t>(trial), 0);
    const fs::path& file = files[static_cast<size_t>(trial) % files.size()];
    const uint64_t bits = 8 * fs::file_size(copy.path() / file);
    const uint64_t bit = (uint64_t{random.next_uint()} << 32 | random.next_uint()) % bits;
    flip(copy.path() / file, bit);
    SCOPED_TRACE(file.string() + ", bit " + std::to_string(bit));

    const Contents contents = read_stores(copy.path(), acknowledged);
    if (!contents.damages.empty()) {
      ++found;
      // What is given out in spite of the damage is right.
      for (const auto& [name, description] : contents.jobs) {
        if (expected.jobs.contains(name)) {
          EXPECT_EQ(description, expected.jobs.at(name));
        }
      }
      for (const std::string& record : contents.records)
        EXPECT_TRUE(std::ranges::binary_search(expected.records, record));
      continue;
    }
    // Unused bytes of the database.
    ++harmless;
    EXPECT_TRUE(contents == expected);
  }
  RecordProperty("found", found);
  RecordProperty("harmless", harmless);
}

}  // namespace
}  // namespace fogbank::faults
