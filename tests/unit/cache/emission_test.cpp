#include "cache/store/emission.h"

#include <gtest/gtest.h>

#include "core/sha256.h"
#include "varied_records.h"

namespace fogbank::cache {
namespace {

using test::same;
using test::varied_records;

TEST(CommonFactor, OfAllEmitters) {
  const std::vector<Spectrum> one{{1, 2, 0}, {3, 4, 0}};
  EXPECT_EQ(common_factor(one, one), Spectrum(1));
  EXPECT_EQ(common_factor(one, {{2, 1, 0}, {6, 2, 0}}), Spectrum(2, 0.5f, 1));
  EXPECT_EQ(common_factor({}, {}), Spectrum(1));
  EXPECT_FALSE(common_factor(one, {{2, 2, 0}, {3, 4, 0}}));
  EXPECT_FALSE(common_factor(one, {{1, 2, 1}, {3, 4, 0}})) << "light of a colour that wasn't there";
  EXPECT_FALSE(common_factor(one, {{0, 2, 0}, {0, 4, 0}})) << "off can't be undone";
  EXPECT_FALSE(common_factor(one, {{1, 2, 0}}));
}

TEST(Scaled, IsLinearInEmission) {
  Record record;
  record.id = 5;
  record.radiance = {1, 2, 3};
  record.gradient = {Vec3f(1, 0, 0), Vec3f(0, 2, 0), Vec3f(0, 0, 3)};
  record.hessian(0, 1) = 4;
  record.variance = 2;
  const Record twice = scaled(record, Spectrum(2));
  EXPECT_EQ(twice.radiance, Spectrum(2, 4, 6));
  EXPECT_EQ(twice.gradient[2], Vec3f(0, 0, 6));
  EXPECT_FLOAT_EQ(twice.hessian(0, 1), 8);
  EXPECT_FLOAT_EQ(twice.variance, 8);
  EXPECT_NE(twice.id, record.id);
  EXPECT_EQ(scaled(record, Spectrum(1, 0.5f, 4)).radiance, Spectrum(1, 1, 12));
}

TEST(UsableRecords, KeepRatiosAlwaysAndTheRestUnderOneFactor) {
  const std::vector<Spectrum> emission{Spectrum(1), Spectrum(2)};
  const RecordSet records(varied_records(240, 1));
  const std::vector<SegmentPart> parts = parts_of(emission, records);
  ASSERT_EQ(parts.size(), 2u);
  const auto usable = [&](const std::vector<Spectrum>& now, std::vector<std::string>& notes) {
    return usable_records(parts, now, notes);
  };
  std::vector<std::string> notes;
  EXPECT_TRUE(same(usable(emission, notes), records));
  EXPECT_TRUE(notes.empty());

  const RecordSet brighter = usable({Spectrum(3), Spectrum(6)}, notes);
  EXPECT_EQ(brighter.size(), records.size());
  ASSERT_EQ(notes.size(), 2u);
  EXPECT_NE(notes[0].find("times 3"), std::string::npos) << notes[0];

  notes.clear();
  const RecordSet other = usable({Spectrum(1), Spectrum(1)}, notes);
  EXPECT_TRUE(same(other, parts[0].records)) << "only what doesn't depend on emission";
  ASSERT_EQ(notes.size(), 2u);
  for (const ComponentRange& range : other.components()) EXPECT_EQ(range.component.quantity, Quantity::ratio);

  notes.clear();
  EXPECT_TRUE(same(usable({Spectrum(3e38f), Spectrum(3e38f)}, notes), parts[0].records));
}

}  // namespace
}  // namespace fogbank::cache
