// Every BSDF against the numbers of Mitsuba 3.9.1 (make_bsdf_vectors.py).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "transport/bsdf_cases.h"
#include "transport/fresnel.h"
#include "transport/material_presets.h"

namespace fogbank::transport {
namespace {

/// Both sides compute in float32 from the same float32 directions. Half vectors carry an error of some 1e-7,
/// which a lobe of roughness alpha turns into a relative one of about 2 slope 1e-7 / alpha^2 in its density:
/// for the sharpest lobe of the table (0.1) and slopes up to twice that some 4e-6 (2e-6 was seen). The rest
/// is headroom for compilers.
constexpr double relative_tolerance = 2e-5;
/// `roughplastic` compares two quadratures of the coat's transmittance and internal reflectance, each good to
/// about 1e-3 (see rough_interface.cpp); 7e-4 was seen.
constexpr double relative_tolerance_quadrature = 2e-3;
/// Densities of Beckmann lobes: ours has the exact masking, Mitsuba's a fit that is off by up to 0.35 %.
constexpr double relative_tolerance_beckmann_density = 4e-3;
constexpr double absolute_tolerance = 2e-6;

/// By name, which is what GoogleTest prints.
class BsdfVectors : public testing::TestWithParam<std::string> {
 protected:
  static const nlohmann::json& entry() {
    for (const nlohmann::json& candidate : test::bsdf_vectors()["cases"])
      if (candidate["name"] == GetParam()) return candidate;
    throw std::out_of_range(GetParam());
  }
};

std::vector<std::string> names() {
  std::vector<std::string> all;
  for (const nlohmann::json& entry : test::bsdf_vectors()["cases"]) all.push_back(entry["name"]);
  return all;
}

Vec3f vector_at(const nlohmann::json& row, size_t first) {
  return {row[first].get<float>(), row[first + 1].get<float>(), row[first + 2].get<float>()};
}

void expect_near(double ours, double mitsuba, double relative, const std::string& what) {
  EXPECT_NEAR(ours, mitsuba, absolute_tolerance + relative * std::fabs(mitsuba)) << what;
}

void expect_near(const Vec3f& ours, const Vec3f& mitsuba, double relative, const std::string& what) {
  for (int channel = 0; channel < 3; ++channel)
    expect_near(ours[channel], mitsuba[channel], relative, what + ", channel " + std::to_string(channel));
}

TEST_P(BsdfVectors, ValueAndDensity) {
  test::BsdfWorkshop workshop;
  const BsdfPointer bsdf = workshop.build(entry()["bsdf"]);
  const ShadingPoint point = test::table_point();
  const nlohmann::json& description = entry()["bsdf"];
  const auto type = description["type"].get<std::string>();
  const bool is_beckmann =
      type.starts_with("rough") && description["parameters"].value("distribution", "") != "ggx";
  const double tolerance = type == "roughplastic" ? relative_tolerance_quadrature : relative_tolerance;
  EXPECT_EQ(bsdf->has_smooth_lobes(), entry().contains("pairs"));
  for (const nlohmann::json& row : entry().value("pairs", nlohmann::json::array())) {
    const BsdfValue ours = bsdf->evaluate_with_pdf(point, vector_at(row, 0), vector_at(row, 3));
    expect_near(ours.value, vector_at(row, 6), tolerance, "value at " + row.dump());
    // Mitsuba leaves a density on the back of some BSDFs that scatter nothing there.
    if (is_black(vector_at(row, 6))) continue;
    expect_near(ours.pdf, row[9].get<double>(), is_beckmann ? relative_tolerance_beckmann_density : tolerance,
                "density at " + row.dump());
  }
}

TEST_P(BsdfVectors, DeltaLobes) {
  test::BsdfWorkshop workshop;
  const BsdfPointer bsdf = workshop.build(entry()["bsdf"]);
  const ShadingPoint point = test::table_point();
  for (const nlohmann::json& row : entry().value("delta", nlohmann::json::array())) {
    const Vec3f wo = vector_at(row, 0);
    const std::optional<BsdfSample> ours = bsdf->sample(point, wo, row[3].get<float>(), {0.3f, 0.6f});
    const Vec3f weight = vector_at(row, 7);
    if (is_black(weight)) {
      EXPECT_TRUE(!ours || is_black(ours->weight)) << row;
      continue;
    }
    ASSERT_TRUE(ours) << row;
    EXPECT_TRUE(ours->delta) << row;
    EXPECT_EQ(ours->null, row[12].get<int>() == 1) << row;
    expect_near(ours->wi, vector_at(row, 4), relative_tolerance, "direction at " + row.dump());
    expect_near(ours->weight, weight, relative_tolerance, "weight at " + row.dump());
    expect_near(ours->pdf, row[10].get<double>(), relative_tolerance, "probability at " + row.dump());
    expect_near(ours->eta, row[11].get<double>(), relative_tolerance, "eta at " + row.dump());
  }
}

TEST_P(BsdfVectors, NullTransmission) {
  test::BsdfWorkshop workshop;
  const BsdfPointer bsdf = workshop.build(entry()["bsdf"]);
  for (const nlohmann::json& row : entry()["null"])
    expect_near(bsdf->null_transmission(test::table_point(), vector_at(row, 0)), vector_at(row, 3),
                relative_tolerance, row.dump());
}

INSTANTIATE_TEST_SUITE_P(Table, BsdfVectors, testing::ValuesIn(names()),
                         [](const auto& test) { return test.param; });

TEST(MaterialPresets, ConductorsAgreeWithMitsuba) {
  const nlohmann::json& table = test::bsdf_vectors()["conductors"];
  for (const auto& [name, numbers] : table.items()) {
    const std::optional<ConductorIndex> ours = named_conductor(name);
    ASSERT_TRUE(ours) << name;
    // The table in the source has six digits; extinctions below 1e-5 are 0 there.
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_NEAR(ours->eta[channel], numbers[static_cast<size_t>(channel)].get<double>(), 2e-5) << name;
      EXPECT_NEAR(ours->k[channel], numbers[static_cast<size_t>(channel) + 3].get<double>(), 2e-5) << name;
    }
  }
}

TEST(MaterialPresets, EveryRegisteredPluginIsInTheTable) {
  std::vector<std::string> types;
  for (const nlohmann::json& entry : test::bsdf_vectors()["cases"]) types.push_back(entry["bsdf"]["type"]);
  for (const std::string& name : supported_bsdfs()) EXPECT_THAT(types, testing::Contains(name));
}

}  // namespace
}  // namespace fogbank::transport
