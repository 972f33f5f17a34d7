#include "cache/record.h"

#include <gmock/gmock.h>

#include <set>

#include "core/error.h"

namespace fogbank::cache {
namespace {

TEST(ContentId, DependsOnEverything) {
  const Component component{3, 2, 1};
  std::set<uint64_t> ids{content_id({1, 2, 3}, component, "settings", 5)};
  ids.insert(content_id({1, 2, std::nextafter(3.0f, 4.0f)}, component, "settings", 5));
  ids.insert(content_id({2, 1, 3}, component, "settings", 5));
  ids.insert(content_id({1, 2, 3}, {4, 2, 1}, "settings", 5));
  ids.insert(content_id({1, 2, 3}, {3, 1, 1}, "settings", 5));
  ids.insert(content_id({1, 2, 3}, {3, 2, 2}, "settings", 5));
  ids.insert(content_id({1, 2, 3}, component, "setting", 5));
  ids.insert(content_id({1, 2, 3}, component, "settings", 6));
  ids.insert(content_id({1, 2, 3}, {3, 2, 1, Quantity::irradiance}, "settings", 5));
  EXPECT_EQ(ids.size(), 9u);
}

TEST(ContentId, IsAFunction) {
  EXPECT_EQ(content_id({1, 2, 3}, {}, "s", 1), content_id({1, 2, 3}, {}, "s", 1));
  EXPECT_EQ(content_id({0.0f, 2, 3}, {}, "s", 1), content_id({-0.0f, 2, 3}, {}, "s", 1));
}

TEST(ContentId, StaysTheSameForEver) {
  // SHA-256 (Python's hashlib) of the little-endian bytes of 1f, 2f, 3f, 7, 8, 9, 2 (32, 16, 8, 8 bits),
  // 10 (64 bits), "abc".
  EXPECT_EQ(content_id({1, 2, 3}, {7, 8, 9, Quantity::ratio}, "abc", 10), 0x7db1af9e492c7158u);
}

void expect_refused(const Record& record, const std::string& field) {
  try {
    validate(record);
    ADD_FAILURE() << "accepted a bad " << field;
  } catch (const Error& error) {
    EXPECT_EQ(error.kind(), ErrorKind::invalid_argument);
    EXPECT_EQ(error.reason(), "INVALID_RECORD");
    EXPECT_THAT(error.what(), testing::HasSubstr(field));
  }
}

TEST(ValidateRecord, NamesTheField) {
  const float nan = std::nanf("");
  EXPECT_NO_THROW(validate(Record{}));
  const auto changed = [](auto change) {
    Record record;
    change(record);
    return record;
  };
  expect_refused(changed([&](Record& r) { r.position.y = nan; }), "position");
  expect_refused(changed([&](Record& r) { r.radiance.z = infinity; }), "radiance");
  expect_refused(changed([&](Record& r) { r.radiance.x = -1e-9f; }), "radiance");
  expect_refused(changed([&](Record& r) { r.gradient[2].x = nan; }), "gradient");
  expect_refused(changed([&](Record& r) { r.hessian(1, 2) = -infinity; }), "hessian");
  expect_refused(changed([&](Record& r) { r.visibility_margin = 0; }), "visibility_margin");
  expect_refused(changed([&](Record& r) { r.visibility_margin = nan; }), "visibility_margin");
  expect_refused(changed([&](Record& r) { r.samples = 0; }), "samples");
  expect_refused(changed([&](Record& r) { r.variance = -1; }), "variance");
}

}  // namespace
}  // namespace fogbank::cache
