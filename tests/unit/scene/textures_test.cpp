// Texture plugins, against numbers of Mitsuba 3.9.1.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "scene/image_files.h"
#include "scene/memory_files.h"
#include "scene/scene_file_reader.h"
#include "scene/texture_library.h"

namespace fogbank::scene::test {
namespace {

using ::testing::HasSubstr;

const SourceLocation where{"scene.xml", 5, "<texture>"};

ObjectPointer object(const std::string& tag, const std::string& type, std::vector<Property> properties) {
  auto description = std::make_shared<ObjectDescription>();
  description->tag = tag;
  description->type = type;
  description->where = where;
  description->properties = std::move(properties);
  return description;
}

Property property(const std::string& name, PropertyValue value) { return {name, std::move(value), where}; }
Property text(const std::string& name, const std::string& value) { return property(name, value); }

class TexturesTest : public ::testing::Test {
 protected:
  TexturePointer bitmap(std::vector<Property> more = {}) {
    more.push_back(text("filename", "grid.png"));
    return library_.texture(object("texture", "bitmap", std::move(more)));
  }

  template <class Make>
  void expect_refused(Make make, const std::string& reason, const std::string& message) {
    try {
      make();
      ADD_FAILURE() << "accepted; expected: " << message;
    } catch (const SceneError& error) {
      EXPECT_EQ(error.reason(), reason);
      EXPECT_THAT(error.what(), HasSubstr(message));
      EXPECT_THAT(error.what(), HasSubstr("scene.xml:5"));
    }
  }

  std::shared_ptr<MemoryFiles> files_ = std::make_shared<MemoryFiles>(std::map<std::string, std::string>{
      {"grid.png", image_file("png", 4, 3, grid)},
      {"same.png", image_file("png", 4, 3, grid)},
      {"bright.exr", image_file<float>("openexr", 2, 1, {0.5f, 0.5f, 0.5f, 2.0f, 2.0f, 2.0f})}});
  TextureLibrary library_{read_in_process(files_)};
};

// `bitmap` with raw=true on the same 4 x 3 image: first channel of `eval`. Mitsuba stores 8-bit texels
// exactly and prints six digits.
constexpr float printed = 2e-6f;
const Vec2f probes[] = {{0.05f, 0.07f}, {0.3f, 0.4f},    {0.9f, 0.95f}, {-0.3f, 0.4f},
                        {1.3f, 2.2f},   {0.99f, -0.99f}, {-1.7f, 0.5f}, {3.4f, -2.6f}};
struct Lookup {
  const char* filter;
  const char* wrap;
  float values[8];
};
constexpr Lookup lookups[] = {
    {"nearest",
     "repeat",
     {0.039216f, 0.980392f, 1.000000f, 0.784314f, 0.235294f, 0.627451f, 0.980392f, 0.980392f}},
    {"nearest",
     "mirror",
     {0.039216f, 0.980392f, 1.000000f, 0.980392f, 0.431373f, 1.000000f, 0.980392f, 0.784314f}},
    {"nearest",
     "clamp",
     {0.039216f, 0.980392f, 1.000000f, 0.823529f, 1.000000f, 0.627451f, 0.823529f, 0.627451f}},
    {"bilinear",
     "repeat",
     {0.319745f, 0.706275f, 0.809510f, 0.654902f, 0.252157f, 0.527722f, 0.933333f, 0.749020f}},
    {"bilinear",
     "mirror",
     {0.039216f, 0.706275f, 1.000000f, 0.706275f, 0.513726f, 1.000000f, 0.933333f, 0.568628f}},
    {"bilinear",
     "clamp",
     {0.039216f, 0.706275f, 1.000000f, 0.588235f, 1.000000f, 0.627451f, 0.823529f, 0.627451f}},
};

TEST_F(TexturesTest, LookupsAreThoseOfMitsuba) {
  for (const Lookup& lookup : lookups) {
    const TexturePointer texture =
        bitmap({property("raw", true), text("filter_type", lookup.filter), text("wrap_mode", lookup.wrap)});
    for (size_t i = 0; i < std::size(probes); ++i) {
      const Spectrum value = texture->evaluate(probes[i]);
      EXPECT_NEAR(value.x, lookup.values[i], printed) << lookup.filter << " " << lookup.wrap << " " << i;
      EXPECT_EQ(value.y, value.x);
      EXPECT_NEAR(texture->evaluate_scalar(probes[i]), lookup.values[i], 2 * printed);
    }
  }
}

TEST_F(TexturesTest, SrgbIsDecodedBeforeFiltering) {
  const TexturePointer texture = bitmap({text("filter_type", "nearest")});
  const float expected[] = {0.003035f, 0.955973f, 1.0f};
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(texture->evaluate(probes[i]).x, expected[i], printed);
}

Mat4d scale_rotate_shift() {
  const double c = std::cos(glm::radians(30.0));
  const double s = std::sin(glm::radians(30.0));
  Mat4d m(1.0);
  m[0] = {2 * c, 2 * s, 0, 0};
  m[1] = {-3 * s, 3 * c, 0, 0};
  m[3] = {0.1, 0.2, 0, 1};
  return m;
}

TEST_F(TexturesTest, ToUvIsAppliedToTheCoordinates) {
  const TexturePointer texture = bitmap({property("raw", true), property("to_uv", scale_rotate_shift())});
  const float expected[] = {0.651589f, 0.715404f, 0.772175f};
  for (size_t i = 0; i < 3; ++i) EXPECT_NEAR(texture->evaluate(probes[i]).x, expected[i], 2 * printed);
}

TEST_F(TexturesTest, GradientsAreDerivatives) {
  const TexturePointer plain = bitmap({property("raw", true)});
  const Vec2f expected[] = {{-2.37569f, -1.07647f}, {0.67451f, 2.27059f}, {-2.40392f, -1.11176f}};
  for (size_t i = 0; i < 3; ++i) {
    const Vec2f gradient = plain->evaluate_scalar_gradient(probes[i]);
    EXPECT_NEAR(gradient.x, expected[i].x, 2e-5f);
    EXPECT_NEAR(gradient.y, expected[i].y, 2e-5f);
  }
  const TexturePointer turned = bitmap({property("raw", true), property("to_uv", scale_rotate_shift())});
  for (size_t i = 0; i < 3; ++i) {
    // Bilinear within a texel, so a central difference has only a rounding error: 1e-7 / 1e-3.
    constexpr float h = 1e-3f;
    const Vec2f gradient = turned->evaluate_scalar_gradient(probes[i]);
    for (int axis = 0; axis < 2; ++axis) {
      Vec2f step(0);
      step[axis] = h;
      const float difference =
          (turned->evaluate_scalar(probes[i] + step) - turned->evaluate_scalar(probes[i] - step)) / (2 * h);
      EXPECT_NEAR(gradient[axis], difference, 1e-2f) << i << " " << axis;
    }
  }
  EXPECT_EQ(bitmap({text("filter_type", "nearest")})->evaluate_scalar_gradient({0.3f, 0.3f}), Vec2f(0));
}

TEST_F(TexturesTest, RangesAndMeans) {
  const TexturePointer texture = bitmap({property("raw", true)});
  float sum = 0;
  for (const uint8_t value : grid) sum += static_cast<float>(value);
  EXPECT_NEAR(texture->mean().x, sum / 12 / 255, 1e-6f);
  EXPECT_EQ(texture->minimum(), 0.0f);
  EXPECT_EQ(texture->maximum(), 1.0f);
  EXPECT_FALSE(texture->is_constant());
}

TEST_F(TexturesTest, CoordinatesOfAnySizeAreSafe) {
  for (const char* wrap : {"repeat", "mirror", "clamp"}) {
    const TexturePointer texture = bitmap({text("wrap_mode", wrap)});
    for (const float u :
         {1e30f, -1e30f, infinity, -infinity, std::nanf(""), 1e9f, -3e7f, one_minus_epsilon, -1e-9f}) {
      const Spectrum value = texture->evaluate({u, -u});
      EXPECT_GE(value.x, 0.0f) << wrap << " " << u;
      EXPECT_LE(value.x, 1.0f) << wrap << " " << u;
    }
  }
}

TEST_F(TexturesTest, Checkerboard) {
  const TexturePointer plain = library_.texture(object("texture", "checkerboard", {}));
  const struct {
    Vec2f uv;
    float value;
  } expected[] = {{{0.1f, 0.1f}, 0.4f},  {{0.6f, 0.1f}, 0.2f},  {{0.1f, 0.6f}, 0.2f}, {{0.6f, 0.6f}, 0.4f},
                  {{-0.1f, 0.1f}, 0.2f}, {{0.5f, 0.25f}, 0.4f}, {{1.2f, 0.3f}, 0.4f}, {{0.5f, 0.5f}, 0.4f}};
  for (const auto& [uv, value] : expected)
    EXPECT_EQ(plain->evaluate(uv), Spectrum(value)) << uv.x << " " << uv.y;
  // As a number the fields change places: what Mitsuba 3.9.1's eval_1 does.
  EXPECT_EQ(plain->evaluate_scalar({0.1f, 0.1f}), 0.2f);
  EXPECT_EQ(plain->evaluate_scalar({0.6f, 0.1f}), 0.4f);
  Mat4d scaled(1.0);
  scaled[0][0] = 4;
  scaled[1][1] = 2;
  const TexturePointer colored = library_.texture(
      object("texture", "checkerboard",
             {property("color0", Spectrum(1, 0, 0)), property("color1", 0.25), property("to_uv", scaled)}));
  EXPECT_EQ(colored->evaluate({0.15f, 0.1f}), Spectrum(0.25f));
  EXPECT_EQ(colored->evaluate({0.05f, 0.1f}), Spectrum(1, 0, 0));
  EXPECT_EQ(colored->mean(), Spectrum(0.625f, 0.125f, 0.125f));
  EXPECT_EQ(colored->maximum(), 1.0f);
  EXPECT_EQ(colored->evaluate_scalar_gradient({0.1f, 0.1f}), Vec2f(0));
}

TEST_F(TexturesTest, Scale) {
  const ObjectPointer nested =
      object("texture", "bitmap", {text("filename", "grid.png"), property("raw", true)});
  const TexturePointer plain = library_.texture(nested);
  const TexturePointer half =
      library_.texture(object("texture", "scale", {property("scale", 0.5), property("", nested)}));
  EXPECT_EQ(half->evaluate(probes[1]), 0.5f * plain->evaluate(probes[1]));
  EXPECT_EQ(half->evaluate_scalar_gradient(probes[1]), 0.5f * plain->evaluate_scalar_gradient(probes[1]));
  EXPECT_EQ(half->maximum(), 0.5f);
  expect_refused([&] { library_.texture(object("texture", "scale", {})); }, "MISSING_PARAMETER",
                 "needs 1 nested <texture>");
}

TEST_F(TexturesTest, ReadTextureTakesNumbersColoursAndTextures) {
  const auto read = [&](std::vector<Property> properties, float highest = 1.0f) {
    const ObjectPointer bsdf = object("bsdf", "diffuse", std::move(properties));
    PropertyReader reader(*bsdf);
    return read_texture(reader, "reflectance", Spectrum(0.5f), 0.0f, highest, library_);
  };
  EXPECT_EQ(read({})->evaluate({0, 0}), Spectrum(0.5f));
  EXPECT_EQ(read({property("reflectance", 0.25)})->evaluate({0, 0}), Spectrum(0.25f));
  const TexturePointer color = read({property("reflectance", Spectrum(0.1f, 0.2f, 0.3f))});
  EXPECT_EQ(color->evaluate({0, 0}), Spectrum(0.1f, 0.2f, 0.3f));
  EXPECT_TRUE(color->is_constant());
  const ObjectPointer nested = object("texture", "bitmap", {text("filename", "grid.png")});
  EXPECT_EQ(read({property("reflectance", nested)}), read({property("reflectance", nested)}))
      << "built twice";
  const ObjectPointer bright = object("texture", "bitmap", {text("filename", "bright.exr")});
  EXPECT_EQ(read({property("reflectance", bright)}, 2.0f)->maximum(), 2.0f);
  expect_refused([&] { read({property("reflectance", bright)}); }, "OUT_OF_RANGE",
                 "must lie within [0, 1], the texture's values are within [0.5, 2]");
  expect_refused([&] { read({property("reflectance", 1.5)}); }, "OUT_OF_RANGE", "1.5");
  expect_refused([&] { read({property("reflectance", object("bsdf", "diffuse", {}))}); }, "WRONG_TYPE", "");
}

TEST_F(TexturesTest, ImagesAreSharedByContent) {
  const ImagePointer first = library_.image("grid.png", false, where);
  EXPECT_EQ(library_.image("grid.png", false, where), first);
  EXPECT_EQ(files_->reads(), 2);  // for its hash, and for its pixels
  EXPECT_EQ(library_.image("same.png", false, where), first);
  EXPECT_NE(library_.image("grid.png", true, where), first);
  EXPECT_GT(library_.seconds(), 0.0);
}

TEST_F(TexturesTest, BadTexturesAreRefused) {
  expect_refused(
      [&] { library_.texture(object("texture", "bitmpa", {})); }, "UNKNOWN_PLUGIN",
      "texture 'bitmpa' is not supported; supported: bitmap, checkerboard, scale; did you mean 'bitmap'?");
  expect_refused([&] { library_.texture(object("texture", "bitmap", {})); }, "MISSING_PARAMETER",
                 "'filename'");
  expect_refused([&] { library_.texture(object("texture", "bitmap", {text("filename", "none.png")})); },
                 "FILE_NOT_FOUND", "none.png");
  expect_refused([&] { bitmap({text("filter_type", "cubic")}); }, "UNKNOWN_CHOICE", "filter_type");
  expect_refused([&] { bitmap({text("wrap_mode", "black")}); }, "UNKNOWN_CHOICE", "wrap_mode");
  expect_refused([&] { bitmap({property("colour", 1.0)}); }, "UNKNOWN_PARAMETER", "colour");
}

TEST_F(TexturesTest, LenientLoadingSubstitutesAndWarns) {
  std::vector<std::string> warnings;
  TextureLibrary lenient(read_in_process(files_), &warnings);
  EXPECT_EQ(lenient.texture(object("texture", "marble", {}))->evaluate({0, 0}), Spectrum(0.5f));
  EXPECT_EQ(lenient.texture(object("texture", "checkerboard", {property("lines", 3.0)}))->maximum(), 0.4f);
  ASSERT_EQ(warnings.size(), 2u);
  EXPECT_THAT(warnings[0], HasSubstr("scene.xml:5: <texture>: texture 'marble' is not supported"));
  EXPECT_THAT(warnings[0], HasSubstr("a grey of 0.5 stands in"));
  EXPECT_THAT(warnings[1], HasSubstr("lines"));
}

TEST_F(TexturesTest, DeepNestingIsRefusedAndWideNestingIsQuick) {
  // Each level refers to the one below twice: asking all of them for a range would take 2^depth steps.
  const auto nested = [&](int depth) {
    ObjectPointer inner = object("texture", "checkerboard", {});
    for (int level = 1; level < depth; ++level)
      inner = object("texture", "checkerboard", {property("color0", inner), property("color1", inner)});
    return inner;
  };
  EXPECT_EQ(library_.texture(nested(32))->maximum(), 0.4f);
  expect_refused([&] { library_.texture(nested(33)); }, "TEXTURES_NESTED_TOO_DEEPLY",
                 "more than 32 levels deep");
}

}  // namespace
}  // namespace fogbank::scene::test
