// What BsdfBuilder refuses, with which words, and what lenient loading makes of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "transport/bsdf_cases.h"

namespace fogbank::transport {
namespace {

using nlohmann::json;

struct Refusal {
  std::string reason;
  std::string message;  ///< part of it
};

/// The error that building `description` ends with.
Refusal refusal(const json& description) {
  test::BsdfWorkshop workshop;
  try {
    workshop.build(description);
  } catch (const SceneError& error) {
    EXPECT_EQ(error.kind(), ErrorKind::invalid_argument);
    EXPECT_EQ(error.where().file, "table.xml");
    return {error.reason(), error.what()};
  }
  return {"none", ""};
}

void expect_refused(const json& description, const std::string& reason, const std::string& message) {
  const Refusal actual = refusal(description);
  EXPECT_EQ(actual.reason, reason) << description;
  EXPECT_THAT(actual.message, testing::HasSubstr(message)) << description;
}

json bsdf(const std::string& type, const json& parameters = json::object(),
          const json& nested = json::array()) {
  return {{"type", type}, {"parameters", parameters}, {"nested", nested}};
}

TEST(BsdfRegistry, NamesAreSorted) {
  const std::vector<std::string> names = supported_bsdfs();
  EXPECT_TRUE(std::is_sorted(names.begin(), names.end()));
  EXPECT_EQ(names.size(), 15u);
}

TEST(BsdfRegistry, RefusesAnUnknownPluginAndNamesTheKnownOnes) {
  expect_refused(
      bsdf("ward"), "UNKNOWN_BSDF",
      "table.xml:1: <bsdf type=\"ward\">: 'ward' is not a BSDF Fogbank knows; supported: blendbsdf, "
      "bumpmap, conductor, dielectric, diffuse, mask, normalmap, null, plastic, principled, "
      "roughconductor, roughdielectric, roughplastic, thindielectric, twosided");
}

TEST(BsdfRegistry, LenientLoadingPutsDiffuseInItsPlace) {
  test::BsdfWorkshop workshop(true);
  const BsdfPointer stand_in = workshop.build(bsdf("ward", {{"alpha", 0.1}}));
  EXPECT_EQ(stand_in->albedo_estimate(), Spectrum(0.5f));
  ASSERT_EQ(workshop.warnings().size(), 1u);
  EXPECT_THAT(workshop.warnings()[0], testing::HasSubstr("'ward' is not a BSDF"));
  EXPECT_THAT(workshop.warnings()[0], testing::HasSubstr("diffuse with reflectance 0.5 stands in"));
}

TEST(BsdfRegistry, LenientLoadingIgnoresAnUnknownParameter) {
  test::BsdfWorkshop workshop(true);
  workshop.build(bsdf("conductor", {{"ext_eta", 1.2}}));
  ASSERT_EQ(workshop.warnings().size(), 1u);
  EXPECT_THAT(workshop.warnings()[0], testing::HasSubstr("ext_eta"));
}

TEST(BsdfRegistry, RefusesWrongParameters) {
  expect_refused(bsdf("diffuse", {{"reflectence", 0.5}}), "UNKNOWN_PARAMETER", "reflectence");
  expect_refused(bsdf("diffuse", {{"reflectance", 1.5}}), "OUT_OF_RANGE", "reflectance");
  expect_refused(bsdf("diffuse", {{"reflectance", "red"}}), "WRONG_TYPE", "reflectance");
  expect_refused(bsdf("diffuse", {{"reflectance", {0.5, -0.1, 0.5}}}), "OUT_OF_RANGE", "reflectance");
  expect_refused(bsdf("dielectric", {{"int_ior", 0}}), "OUT_OF_RANGE", "int_ior");
  expect_refused(bsdf("dielectric", {{"int_ior", "beer"}}), "UNKNOWN_MATERIAL",
                 "'beer' is not a dielectric Fogbank knows; supported: acetone, acrylic glass, air");
  expect_refused(bsdf("conductor", {{"material", "au"}}), "UNKNOWN_MATERIAL", "'au' is not a conductor");
  expect_refused(bsdf("conductor", {{"material", "Au"}, {"k", 1}}), "CONFLICTING_PARAMETERS", "not both");
  expect_refused(bsdf("roughconductor", {{"alpha", -0.1}}), "OUT_OF_RANGE", "alpha");
  expect_refused(bsdf("roughconductor", {{"alpha", 0.1}, {"alpha_u", 0.1}}), "CONFLICTING_PARAMETERS",
                 "not both");
  expect_refused(bsdf("roughconductor", {{"alpha_u", 0.1}}), "MISSING_PARAMETER", "together");
  expect_refused(bsdf("roughconductor", {{"distribution", "phong"}}), "UNKNOWN_CHOICE",
                 "supported: beckmann, ggx");
  expect_refused(bsdf("roughdielectric", {{"int_ior", 1.5}, {"ext_ior", 1.5}}), "INDICES_EQUAL",
                 "must differ");
  expect_refused(bsdf("roughplastic", {{"alpha", 11}}), "OUT_OF_RANGE", "alpha");
  expect_refused(bsdf("roughplastic", {{"alpha_u", 0.1}}), "UNKNOWN_PARAMETER", "alpha_u");
  expect_refused(bsdf("principled", {{"eta", 1.5}, {"specular", 0.5}}), "CONFLICTING_PARAMETERS", "not both");
  expect_refused(bsdf("principled", {{"metallic", 2}}), "OUT_OF_RANGE", "metallic");
}

TEST(BsdfRegistry, RefusesWrongNesting) {
  const json diffuse = bsdf("diffuse");
  expect_refused(bsdf("mask"), "WRONG_NUMBER_OF_BSDFS", "needs 1 nested <bsdf>, has 0");
  expect_refused(bsdf("twosided", json::object(), json::array({diffuse, diffuse, diffuse})),
                 "WRONG_NUMBER_OF_BSDFS", "needs 1 or 2 nested <bsdf>, has 3");
  expect_refused(bsdf("twosided", json::object(), json::array({bsdf("dielectric")})), "TRANSMITTING_BSDF",
                 "let no light through");
  expect_refused(bsdf("blendbsdf", {{"weight", 0.5}}, json::array({diffuse})), "WRONG_NUMBER_OF_BSDFS",
                 "needs 2 nested <bsdf>, has 1");
  expect_refused(bsdf("blendbsdf", json::object(), json::array({diffuse, diffuse})), "MISSING_PARAMETER",
                 "weight");
  expect_refused(bsdf("normalmap", json::object(), json::array({diffuse})), "MISSING_PARAMETER", "normalmap");
  expect_refused(bsdf("bumpmap", json::object(), json::array({diffuse})), "WRONG_NUMBER_OF_TEXTURES",
                 "needs 1 nested <texture>, has 0");
  expect_refused(bsdf("diffuse", json::object(), json::array({diffuse})), "UNKNOWN_PARAMETER", "<bsdf");
  json deep = diffuse;
  for (int level = 0; level < 20; ++level) deep = bsdf("twosided", json::object(), json::array({deep}));
  expect_refused(deep, "BSDF_NESTED_TOO_DEEPLY", "more than 16 levels");
}

TEST(BsdfRegistry, AcceptsTransmissionInTwoSidedWhenAllowed) {
  EXPECT_EQ(
      refusal(bsdf("twosided", {{"allow_transmission", true}}, json::array({bsdf("dielectric")}))).reason,
      "none");
}

TEST(BsdfRegistry, BuildsASharedDescriptionOnce) {
  test::BsdfWorkshop workshop;
  const scene::ObjectPointer description = test::describe_bsdf(bsdf("diffuse"));
  EXPECT_EQ(workshop.build(description), workshop.build(description));
}

TEST(BsdfRegistry, KnowsWhatLetsLightThrough) {
  test::BsdfWorkshop workshop;
  for (const char* type : {"null", "dielectric", "thindielectric", "roughdielectric"})
    EXPECT_TRUE(workshop.build(bsdf(type))->transmits()) << type;
  for (const char* type : {"diffuse", "conductor", "roughconductor", "plastic", "roughplastic", "principled"})
    EXPECT_FALSE(workshop.build(bsdf(type))->transmits()) << type;
  EXPECT_TRUE(workshop.build(bsdf("principled", {{"spec_trans", 0.5}}))->transmits());
  EXPECT_TRUE(workshop.build(bsdf("mask", json::object(), json::array({bsdf("diffuse")})))->transmits());
}

}  // namespace
}  // namespace fogbank::transport
