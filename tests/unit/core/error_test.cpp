#include "core/error.h"

#include <gtest/gtest.h>

namespace fogbank {
namespace {

TEST(Error, CarriesKindReasonAndMessage) {
  const Error error(ErrorKind::resource_exhausted, "TOO_MANY_JOBS", "the queue holds 64 jobs");
  EXPECT_EQ(error.kind(), ErrorKind::resource_exhausted);
  EXPECT_EQ(error.reason(), "TOO_MANY_JOBS");
  EXPECT_STREQ(error.what(), "the queue holds 64 jobs");
}

TEST(SourceLocation, NamesOnlyWhatIsKnown) {
  EXPECT_EQ((SourceLocation{"room.xml", 12, "<shape type=\"obj\">"}.to_string()),
            "room.xml:12: <shape type=\"obj\">");
  EXPECT_EQ((SourceLocation{"room.xml", 0, "<scene>"}.to_string()), "room.xml: <scene>");
  EXPECT_EQ((SourceLocation{"room.xml", 3, ""}.to_string()), "room.xml:3");
  EXPECT_EQ((SourceLocation{"room.xml", 0, ""}.to_string()), "room.xml");
}

TEST(SceneError, SaysWhereBeforeItSaysWhat) {
  const SourceLocation where{"meshes/wall.ply", 7, "face"};
  const SceneError error(ErrorKind::invalid_argument, "INDEX_OUT_OF_RANGE", where, "vertex 9 of 8");
  EXPECT_STREQ(error.what(), "meshes/wall.ply:7: face: vertex 9 of 8");
  EXPECT_EQ(error.where().line, 7);
  EXPECT_EQ(error.reason(), "INDEX_OUT_OF_RANGE");
}

TEST(SceneError, CanBeCaughtAsError) {
  const auto fail = [] {
    throw SceneError(ErrorKind::unsupported, "UNSUPPORTED_PLUGIN", {}, "no such plugin");
  };
  EXPECT_THROW(fail(), Error);
}

}  // namespace
}  // namespace fogbank
