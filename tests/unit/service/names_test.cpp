#include "service/names.h"

#include <gtest/gtest.h>

#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {
namespace {

TEST(Names, JobIdsAreUniqueAndSortByAge) {
  std::string last;
  for (int i = 0; i < 1000; ++i) {
    const std::string id = new_job_id();
    EXPECT_EQ(parse_job_name(job_name(id)), id);
    EXPECT_LT(last, id);
    last = id;
  }
}

TEST(Names, LogicalPaths) {
  for (const char* good :
       {"a", "a/b.xml", "Sky 19.exr", "..a/b..", "\xc3\xa9t\xc3\xa9.xml", "-", "a/.hidden"}) {
    EXPECT_NO_THROW(check_logical_path(good, "field")) << good;
  }
  for (const std::string& bad :
       {std::string(), std::string("/"), std::string("/a"), std::string("a/"), std::string("a//b"),
        std::string("."), std::string(".."), std::string("a/.."), std::string("../a"), std::string("a/./b"),
        std::string("a\\b"), std::string("a\nb"), std::string("a\0b", 3),
        std::string(limits::max_path_bytes + 1, 'a')}) {
    EXPECT_THROW(check_logical_path(bad, "field"), RpcError) << bad;
  }
}

TEST(Names, PageSizes) {
  EXPECT_EQ(effective_page_size(0), limits::default_page_size);
  EXPECT_EQ(effective_page_size(7), 7);
  EXPECT_EQ(effective_page_size(1 << 30), limits::max_page_size);
  EXPECT_THROW(effective_page_size(-1), RpcError);
}

}  // namespace
}  // namespace fogbank::service
