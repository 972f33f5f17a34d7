// Every call of the stores to the kernel fails once: faults C3, and C5 at each acknowledgement.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

#include "cache/temporary_folder.h"
#include "syscalls.h"
#include "workload.h"

namespace fogbank::faults {
namespace {

using cache::test::TemporaryFolder;

/// `make test-faults` tries every call; else so many of each kind of fault, evenly spread.
int64_t most_calls() {
  const char* const text = std::getenv("FOGBANK_FAULT_CALLS");
  return text == nullptr ? 12 : std::stoll(text);
}

int64_t count_calls() {
  const TemporaryFolder folder;
  Acknowledged acknowledged;
  watch_calls(folder.path(), Fault::none, 0);
  use_stores(folder.path(), acknowledged);
  const int64_t calls = stop_watching();
  EXPECT_EQ(acknowledged.errors, std::vector<std::string>());
  EXPECT_EQ(missing(read_stores(folder.path(), acknowledged), acknowledged), std::vector<std::string>());
  return calls;
}

class NthCall : public ::testing::TestWithParam<Fault> {};

TEST_P(NthCall, LosesNothingThatWasAcknowledged) {
  const int64_t calls = count_calls();
  ASSERT_GT(calls, 60);
  const int64_t step = std::max<int64_t>(1, calls / most_calls());
  int64_t failures = 0;
  int tried = 0;
  for (int64_t number = 1; number <= calls; number += step) {
    SCOPED_TRACE("call " + std::to_string(number));
    ++tried;
    const TemporaryFolder folder;
    Acknowledged acknowledged;
    watch_calls(folder.path(), GetParam(), number);
    use_stores(folder.path(), acknowledged);
    stop_watching();
    failures += static_cast<int64_t>(acknowledged.errors.size());
    for (const std::string& error : acknowledged.errors)
      EXPECT_TRUE(error == "DISK_FULL" || error == "STORAGE_ERROR") << error;
    EXPECT_EQ(acknowledged.not_durable, std::vector<std::string>());
    EXPECT_EQ(missing(read_stores(folder.path(), acknowledged), acknowledged), std::vector<std::string>());

    // The fault has gone: everything works, on what it has left.
    acknowledged.errors.clear();
    watch_calls(folder.path(), Fault::none, 0);
    use_stores(folder.path(), acknowledged);
    stop_watching();
    EXPECT_EQ(acknowledged.errors, std::vector<std::string>());
    EXPECT_EQ(missing(read_stores(folder.path(), acknowledged), acknowledged), std::vector<std::string>());
    if (HasFailure()) return;
  }
  RecordProperty("calls", static_cast<int>(calls));
  RecordProperty("tried", tried);
  // Short writes are gone on with.
  if (GetParam() != Fault::short_write) {
    EXPECT_GT(failures, 0);
  }
}

std::string name_of(const ::testing::TestParamInfo<Fault>& fault) {
  switch (fault.param) {
    case Fault::no_space:
      return "NoSpace";
    case Fault::no_space_anymore:
      return "NoSpaceAnymore";
    case Fault::io_error:
      return "IoError";
    case Fault::no_descriptors:
      return "NoDescriptors";
    case Fault::short_write:
      return "ShortWrite";
    case Fault::none:
      break;
  }
  return "None";
}

INSTANTIATE_TEST_SUITE_P(Faults, NthCall,
                         ::testing::Values(Fault::no_space, Fault::no_space_anymore, Fault::io_error,
                                           Fault::no_descriptors, Fault::short_write),
                         name_of);

}  // namespace
}  // namespace fogbank::faults
