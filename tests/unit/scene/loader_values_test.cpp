// Numbers, colours, spectra and transforms as scene files write them.
#include <gtest/gtest.h>

#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>

#include "scene/xml/spectrum.h"
#include "scene/xml/transform.h"
#include "scene/xml/upgrade.h"
#include "scene/xml/values.h"

namespace fogbank::scene::test {
namespace {

TEST(ParseNumber, Accepts) {
  EXPECT_EQ(parse_number("1"), 1.0);
  EXPECT_EQ(parse_number(" +.5\n"), 0.5);
  EXPECT_EQ(parse_number("-1.5e-3"), -1.5e-3);
  EXPECT_EQ(parse_number("9.42177e-010"), 9.42177e-10);
  EXPECT_EQ(parse_number("1e-400"), 0.0);
  EXPECT_EQ(parse_number("1e400"), std::numeric_limits<double>::infinity());
  EXPECT_EQ(parse_number("-1e400"), -std::numeric_limits<double>::infinity());
  EXPECT_EQ(parse_number("1e308"), 1e308);
  EXPECT_EQ(parse_number("-0"), 0.0);
  EXPECT_EQ(parse_number("4.9e-324"), 4.9e-324);
  EXPECT_EQ(parse_number("0." + std::string(400, '0') + "1"), 0.0);
  EXPECT_EQ(parse_number(std::string(400, '9')), std::numeric_limits<double>::infinity());
  EXPECT_TRUE(std::isnan(parse_number("nan").value()));
}

TEST(ParseNumber, Refuses) {
  for (const char* text : {"", " ", "a", "1a", "1 2", "1,2", "0x10", "--1", "+-1", "1e", ".", "1.2.3", "1f"})
    EXPECT_FALSE(parse_number(text).has_value()) << text;
}

TEST(ParseInteger, AcceptsAndRefuses) {
  EXPECT_EQ(parse_integer(" -12 "), -12);
  EXPECT_EQ(parse_integer("+7"), 7);
  for (const char* text : {"", "1.5", "1e3", "+-1", "99999999999999999999", "0x1", "one"})
    EXPECT_FALSE(parse_integer(text).has_value()) << text;
}

TEST(ParseNumbers, BlanksAndCommas) {
  const std::vector<double> expected = {1, 2, 3};
  for (const char* text : {"1 2 3", "1,2,3", " 1,  2\t3\n", "1 , 2 ,3"})
    EXPECT_EQ(parse_numbers(text), expected);
  EXPECT_EQ(parse_numbers(""), std::vector<double>{});
  for (const char* text : {"1,,2", "1 2,", ",1 2", "1;2"})
    EXPECT_FALSE(parse_numbers(text).has_value()) << text;
}

TEST(ParseColour, NumbersAndHexadecimal) {
  EXPECT_EQ(parse_colour("0.5"), Vec3d(0.5));
  EXPECT_EQ(parse_colour("0.1, 0.2, 0.3"), Vec3d(0.1, 0.2, 0.3));
  EXPECT_EQ(parse_colour("#ff8000"), Vec3d(255, 128, 0) / 255.0);
  for (const char* text : {"", "1 2", "1 2 3 4", "#fff", "#gg0000", "#ff800000", "red"})
    EXPECT_FALSE(parse_colour(text).has_value()) << text;
}

TEST(ParseBoolean, AnyCase) {
  EXPECT_EQ(parse_boolean("true"), true);
  EXPECT_EQ(parse_boolean(" False "), false);
  EXPECT_FALSE(parse_boolean("1").has_value());
}

TEST(SampledSpectra, Parse) {
  const auto spectrum = parse_sampled_spectrum("400:0.1, 500:0.3 600:0.9");
  ASSERT_TRUE(spectrum.has_value());
  EXPECT_EQ(spectrum->wavelengths, (std::vector<double>{400, 500, 600}));
  EXPECT_EQ(spectrum->values, (std::vector<double>{0.1, 0.3, 0.9}));
  for (const char* text : {"", "400:1", "400:1 400:2", "500:1 400:1", "400:1 500", "400:1 :2", "400: 1"})
    EXPECT_FALSE(parse_sampled_spectrum(text).has_value()) << text;
}

struct SpectrumCase {
  const char* text;
  Vec3f reflectance;
  Vec3f emission;
};

TEST(SampledSpectra, AgreeWithMitsuba) {
  // Colours that Mitsuba 3.9.1 (scalar_rgb) computes with the same colour matching functions. A spectrum that
  // begins or ends with a jump depends on the quadrature there: 0.5 % for the last one, 0.1 % for smooth
  // ones.
  const SpectrumCase cases[] = {
      {"400:0.1, 500:0.3, 600:0.9, 700:0.4",
       {0.929551f, 0.559676f, 0.155033f},
       {1.07097f, 0.539033f, 0.131843f}},
      {"360:1, 830:1", {0.998985f, 0.998874f, 0.998802f}, {1.20488f, 0.948228f, 0.909267f}},
      {"400:1, 700:1", {0.995342f, 0.999756f, 0.994909f}, {1.19969f, 0.94952f, 0.903443f}},
      {"500:0.5, 600:0.5", {0.104902f, 0.511832f, 0.0f}, {0.136533f, 0.493956f, 0.0f}},
      {"600:1, 700:1", {0.841138f, 0.0f, 0.0f}, {0.968726f, 0.0f, 0.0f}},
  };
  for (const SpectrumCase& expected : cases) {
    SCOPED_TRACE(expected.text);
    const SampledSpectrum spectrum = parse_sampled_spectrum(expected.text).value();
    const Spectrum reflectance = reflectance_to_srgb(spectrum);
    const Spectrum emission = emission_to_srgb(spectrum);
    for (int channel = 0; channel < 3; ++channel) {
      EXPECT_NEAR(reflectance[channel], expected.reflectance[channel], 0.005f);
      EXPECT_NEAR(emission[channel], expected.emission[channel], 0.005f);
    }
  }
}

TEST(SampledSpectra, FlatReflectanceIsGreyExactly) {
  const Spectrum grey = reflectance_to_srgb({{360, 500, 830}, {0.4, 0.4, 0.4}});
  for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(grey[channel], 0.4f, 1e-6f);
  // Mitsuba 3.9.1 for <spectrum value="3"/> in an emitter: (3.61438, 2.84487, 2.72675).
  const Spectrum white = 3.0f * equal_energy_white();
  EXPECT_NEAR(white.x, 3.61438f, 1e-4f);
  EXPECT_NEAR(white.y, 2.84487f, 1e-4f);
  EXPECT_NEAR(white.z, 2.72675f, 1e-4f);
}

TEST(Srgb, TransferFunction) {
  EXPECT_EQ(srgb_to_linear(0), 0);
  EXPECT_NEAR(srgb_to_linear(1), 1, 1e-15);
  EXPECT_NEAR(srgb_to_linear(0.5), 0.2140411, 1e-7);
}

XmlElement element(const std::string& tag, std::vector<XmlAttribute> attributes,
                   std::vector<XmlElement> children = {}) {
  return {tag, std::move(attributes), std::move(children), {"scene.xml", 1, "<" + tag + ">"}, false};
}

void expect_matrix(const Mat4d& actual, const Mat4d& expected) {
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row)
      EXPECT_NEAR(actual[column][row], expected[column][row], 1e-12) << "row " << row << " column " << column;
}

TEST(Transforms, LaterStepsApplyAfterEarlierOnes) {
  const XmlElement transform =
      element("transform", {},
              {element("scale", {{"value", "2"}}), element("translate", {{"x", "1"}, {"z", "-3"}}),
               element("rotate", {{"z", "1"}, {"angle", "90"}})});
  // (1, 1, 1) -> (2, 2, 2) -> (3, 2, -1) -> (-2, 3, -1)
  const Vec3d moved(read_transform(transform) * glm::dvec4(1, 1, 1, 1));
  EXPECT_NEAR(glm::length(moved - Vec3d(-2, 3, -1)), 0, 1e-12);
}

TEST(Transforms, Matrix) {
  expect_matrix(read_transform(element("transform", {},
                                       {element("matrix", {{"value", "1 2 3 4 0 1 5 6 0 0 2 7 0 0 0 1"}})})),
                glm::transpose(Mat4d(1, 2, 3, 4, 0, 1, 5, 6, 0, 0, 2, 7, 0, 0, 0, 1)));
  expect_matrix(
      read_transform(element("transform", {}, {element("matrix", {{"value", "1 2 3, 0 1 5, 0 0 2"}})})),
      glm::transpose(Mat4d(1, 2, 3, 0, 0, 1, 5, 0, 0, 0, 2, 0, 0, 0, 0, 1)));
}

TEST(Transforms, Lookat) {
  const Mat4d m = read_transform(
      element("transform", {},
              {element("lookat", {{"origin", "1, 2, 3"}, {"target", "1, 2, 8"}, {"up", "0, 2, 0"}})}));
  expect_matrix(m, glm::translate(Mat4d(1.0), Vec3d(1, 2, 3)));
}

TEST(Transforms, VectorsAsValue) {
  EXPECT_EQ(read_vector(element("translate", {{"value", "1, 2, 3"}}), 0), Vec3d(1, 2, 3));
  EXPECT_EQ(read_vector(element("scale", {{"y", "2"}}), 1), Vec3d(1, 2, 1));
}

TEST(SnakeCase, OldNames) {
  const std::pair<const char*, const char*> cases[] = {{"toWorld", "to_world"},
                                                       {"intIOR", "int_ior"},
                                                       {"extIOR", "ext_ior"},
                                                       {"maxDepth", "max_depth"},
                                                       {"sigmaS", "sigma_s"},
                                                       {"faceNormals", "face_normals"},
                                                       {"shapeIndex", "shape_index"},
                                                       {"diffuseReflectance", "diffuse_reflectance"},
                                                       {"kNN", "k_nn"},
                                                       {"to_world", "to_world"},
                                                       {"alphaU", "alpha_u"},
                                                       {"URL", "URL"},
                                                       {"", ""}};
  for (const auto& [old_name, name] : cases) EXPECT_EQ(snake_case(old_name), name);
}

}  // namespace
}  // namespace fogbank::scene::test
