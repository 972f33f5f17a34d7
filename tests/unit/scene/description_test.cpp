// Typed reading of parameters, and what it says about wrong ones.
#include "scene/description.h"

#include <gtest/gtest.h>

#include <limits>

#include "scene/scene_files.h"
#include "scene/text.h"

namespace fogbank::scene::test {
namespace {

class PropertyReaderTest : public ::testing::Test {
 protected:
  PropertyReaderTest() {
    object_.tag = "bsdf";
    object_.type = "plastic";
    object_.where = {"scene.xml", 4, "<bsdf type=\"plastic\">"};
  }

  void add(const std::string& name, PropertyValue value) {
    object_.properties.push_back({name, std::move(value), {"scene.xml", ++line_, "<x>"}});
  }

  template <typename Action>
  std::string message(const Action& action) {
    PropertyReader reader(object_);
    return thrown_by([&] { action(reader); }).message;
  }

  ObjectDescription object_;
  int line_ = 4;
};

TEST_F(PropertyReaderTest, ReadsEveryType) {
  add("flag", true);
  add("count", int64_t{7});
  add("size", 2.5);
  add("name", std::string("x"));
  add("direction", Vec3d(1, 2, 3));
  add("colour", Spectrum(0.1f, 0.2f, 0.3f));
  add("grey", Spectrum(0.5f));
  add("to_world", Mat4d(2.0));
  auto nested = std::make_shared<ObjectDescription>();
  nested->tag = "texture";
  add("map", ObjectPointer(nested));
  PropertyReader reader(object_);
  EXPECT_TRUE(reader.boolean("flag", false));
  EXPECT_EQ(reader.integer("count", 0, 0, 10), 7);
  EXPECT_EQ(reader.number("size", 0, 0, 10), 2.5);
  EXPECT_EQ(reader.text("name", ""), "x");
  EXPECT_EQ(reader.vector("direction", Vec3d(0)), Vec3d(1, 2, 3));
  EXPECT_EQ(reader.spectrum("colour", Spectrum(0), 0, 1), Spectrum(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(reader.number("grey", 0, 0, 1), 0.5);
  EXPECT_EQ(reader.transform("to_world"), Mat4d(2.0));
  EXPECT_EQ(reader.child("map", "texture"), nested);
  reader.finish();
}

TEST_F(PropertyReaderTest, NumbersOfOtherTypes) {
  add("count", int64_t{7});
  add("size", 0.25);
  PropertyReader reader(object_);
  EXPECT_EQ(reader.number("count", 0, 0, 10), 7);
  EXPECT_EQ(reader.spectrum("size", Spectrum(0), 0, 1), Spectrum(0.25f));
}

TEST_F(PropertyReaderTest, Defaults) {
  PropertyReader reader(object_);
  EXPECT_TRUE(reader.boolean("flag", true));
  EXPECT_EQ(reader.integer("count", 5, 0, 1), 5);
  EXPECT_FALSE(reader.number_if_given("size", 0, 1).has_value());
  EXPECT_EQ(reader.transform("to_world"), Mat4d(1.0));
  EXPECT_EQ(reader.child("map", "texture"), nullptr);
  EXPECT_EQ(reader.raw("map"), nullptr);
  reader.finish();
}

TEST_F(PropertyReaderTest, WrongValuesAreNamed) {
  constexpr double inf = std::numeric_limits<double>::infinity();
  add("size", 2.5);                                                        // line 5
  add("big", std::numeric_limits<double>::quiet_NaN());                    // line 6
  add("colour", Spectrum(0.5f, -1.0f, 0.5f));                              // line 7
  add("kind", std::string("ggz"));                                         // line 8
  add("bad", Spectrum(std::numeric_limits<float>::infinity(), 0.f, 0.f));  // line 9
  const std::string at = ": <bsdf type=\"plastic\">: parameter ";
  EXPECT_EQ(message([](auto& r) { r.number("size", 0, 0, 1); }),
            "scene.xml:5" + at + "'size': must lie in [0, 1], is 2.5");
  EXPECT_EQ(message([](auto& r) { r.number("size", 0, 3, inf); }),
            "scene.xml:5" + at + "'size': must be at least 3, is 2.5");
  EXPECT_EQ(message([](auto& r) { r.number("size", 0, -inf, 2); }),
            "scene.xml:5" + at + "'size': must be at most 2, is 2.5");
  EXPECT_EQ(message([](auto& r) { r.integer("size", 0, 0, 1); }),
            "scene.xml:5" + at + "'size': must be an integer, is a float");
  EXPECT_EQ(message([](auto& r) { r.boolean("size", false); }),
            "scene.xml:5" + at + "'size': must be a boolean, is a float");
  EXPECT_EQ(message([](auto& r) { r.transform("size"); }),
            "scene.xml:5" + at + "'size': must be a transform, is a float");
  EXPECT_EQ(message([](auto& r) { r.child("size", "texture"); }),
            "scene.xml:5" + at + "'size': must be a <texture>, is a float");
  EXPECT_EQ(message([](auto& r) { r.number("big", 0, 0, 1); }),
            "scene.xml:6" + at + "'big': must be finite, is nan");
  EXPECT_EQ(message([](auto& r) { r.spectrum("colour", Spectrum(0), 0, 1); }),
            "scene.xml:7" + at + "'colour': must lie in [0, 1], is -1");
  EXPECT_EQ(message([](auto& r) { r.number("colour", 0, 0, 1); }),
            "scene.xml:7" + at + "'colour': must be a float, is an rgb or spectrum");
  EXPECT_EQ(
      message([](auto& r) {
        r.choice("kind", "beckmann", {"beckmann", "ggx"});
      }),
      "scene.xml:8" + at + "'kind': 'ggz' is not supported; supported: beckmann, ggx; did you mean 'ggx'?");
  EXPECT_EQ(message([](auto& r) { r.spectrum("bad", Spectrum(0), 0, 1); }),
            "scene.xml:9" + at + "'bad': must be finite, is inf");
}

TEST_F(PropertyReaderTest, LeftOverParameters) {
  add("alpah", 0.1);
  EXPECT_EQ(
      message([](auto& r) {
        r.number("alpha", 0.1, 0, 1);
        r.number("int_ior", 1.5, 1, 3);
        r.finish();
      }),
      "scene.xml:5: <bsdf type=\"plastic\">: unknown parameter 'alpah'; supported: alpha, int_ior; did you "
      "mean 'alpha'?");
  PropertyReader reader(object_);
  std::vector<std::string> warnings;
  reader.finish(&warnings);
  EXPECT_EQ(warnings, std::vector<std::string>{
                          "scene.xml:5: <bsdf type=\"plastic\">: unknown parameter 'alpah' is ignored"});
}

TEST_F(PropertyReaderTest, LeftOverObjects) {
  auto nested = std::make_shared<ObjectDescription>();
  nested->tag = "texture";
  nested->where.element = "<texture type=\"bitmap\">";
  add("", ObjectPointer(nested));
  EXPECT_EQ(message([](auto& r) {
              r.children("bsdf");
              r.finish();
            }),
            "scene.xml:5: <bsdf type=\"plastic\">: unexpected <texture type=\"bitmap\">; supported: <bsdf>");
}

TEST(Quote, EscapesAndCuts) {
  EXPECT_EQ(quote("a\nb\x1b"), "'a\\x0ab\\x1b'");
  EXPECT_EQ(quote(std::string(100, 'x')), "'" + std::string(100, 'x') + "'");
  EXPECT_EQ(quote(std::string(101, 'x')), "'" + std::string(100, 'x') + "...'");
  // 99 letters and a two-byte letter across the cut.
  EXPECT_EQ(quote(std::string(99, 'x') + "\xC3\xBC" + "y"), "'" + std::string(99, 'x') + "...'");
}

TEST(DidYouMean, NearNamesOnly) {
  EXPECT_EQ(did_you_mean("sigmaT", {"sigma_t", "albedo"}), "; did you mean 'sigma_t'?");
  EXPECT_EQ(did_you_mean("xyz", {"sigma_t", "albedo"}), "");
  EXPECT_EQ(did_you_mean("g", {"a", "b"}), "");
}

}  // namespace
}  // namespace fogbank::scene::test
