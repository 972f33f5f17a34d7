// Damaged scene files: whatever is changed in a good one, the loader loads it or throws an Error, and what it
// loads is finite.
#include <gtest/gtest.h>

#include <map>

#include "core/random.h"
#include "scene/loader.h"
#include "scene/scene_files.h"

namespace fogbank::scene::test {
namespace {

/// Files in memory.
class MemorySource final : public FileSource {
 public:
  explicit MemorySource(std::map<std::string, std::string> files) : files_(std::move(files)) {}
  bool exists(const std::string& path) const override { return files_.count(path) > 0; }
  std::string read(const std::string& path) const override {
    const auto found = files_.find(path);
    if (found == files_.end()) throw Error(ErrorKind::not_found, "FILE_NOT_FOUND", "no file");
    return found->second;
  }

 private:
  std::map<std::string, std::string> files_;
};

const char* const good_scene = R"(<?xml version="1.0"?>
<scene version="0.6.0"><default name="w" value="8"/><path value="sub"/><include filename="part.xml"/>
<integrator type="volpath"><integer name="maxDepth" value="5"/></integrator>
<sensor type="thinlens"><float name="fov" value="40"/><string name="fovAxis" value="diagonal"/>
<float name="apertureRadius" value="0.1"/><transform name="toWorld"><lookAt origin="0, 0, -4" target="0, 0, 0"
up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="$w"/><integer name="cropWidth" value="4"/>
<rfilter type="tent"/></film><ref name="medium" id="fog"/></sensor>
<medium type="homogeneous" id="fog"><rgb name="sigmaS" value="1, 2, 3"/><spectrum name="sigmaA" value="400:1, 700:2"/>
<float name="scale" value="2"/><phase type="hg"><float name="g" value="0.5"/></phase></medium>
<bsdf type="twosided" id="b"><bsdf type="diffuse"><srgb name="reflectance" value="#808080"/></bsdf></bsdf>
<alias id="b" as="c"/>
<shape type="cube"><ref name="interior" id="fog"/></shape>
<shape type="sphere"><point name="center" x="1" y="2" z="3"/><float name="radius" value="2"/><ref id="c"/>
<emitter type="area"><spectrum name="radiance" value="16"/></emitter></shape>
<shape type="cylinder"><point name="p1" value="0, 1, 2"/><transform name="toWorld"><scale value="2"/>
<rotate x="1" angle="30"/><translate z="4"/><matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/></transform></shape>
<shape type="shapegroup" id="g"><shape type="rectangle"/></shape>
<shape type="instance"><ref id="g"/></shape></scene>)";

/// What tends to upset parsers.
const std::vector<std::string> fragments = {"<",
                                            ">",
                                            "\"",
                                            "'",
                                            "&",
                                            "&#0;",
                                            "<!--",
                                            "-->",
                                            "<![CDATA[",
                                            "]]>",
                                            "<?",
                                            "$",
                                            "$w",
                                            "#",
                                            ":",
                                            ",",
                                            "nan",
                                            "inf",
                                            "-1",
                                            "0",
                                            "1e38",
                                            "1e-46",
                                            "1e999",
                                            "-",
                                            "..",
                                            "\\",
                                            "</scene>",
                                            "<ref id='g'/>",
                                            "<include filename='scene.xml'/>",
                                            "<include filename='part.xml'/>",
                                            std::string(1, '\0'),
                                            "\xFF",
                                            "\xC3\xBC",
                                            "<shape type='cube'>",
                                            "</shape>",
                                            "/>",
                                            " type=",
                                            "99999999999999999999"};

const std::vector<std::string> numbers = {"0",    "-1",    "1",     "1e-46", "1e-20", "1e20",
                                          "3e38", "1e39",  "-1e20", "0.5",   "nan",   "-inf",
                                          "180",  "16385", "4",     "7",     "1e10",  "1e-10"};

/// Another number in the place of one digit: still well-formed, often still a scene.
std::string with_other_number(std::string text, RandomStream& random) {
  while (true) {
    const size_t at = static_cast<size_t>(random.next_uint()) % text.size();
    if (text[at] < '0' || text[at] > '9') continue;
    return text.replace(at, 1, numbers[static_cast<size_t>(random.next_uint()) % numbers.size()]);
  }
}

std::string mutated(std::string text, RandomStream& random) {
  const auto below = [&](size_t n) { return static_cast<size_t>(random.next_uint()) % n; };
  const size_t edits = 1 + below(4);
  for (size_t i = 0; i < edits && !text.empty(); ++i) {
    const size_t at = below(text.size());
    switch (below(4)) {
      case 0:
        text[at] = static_cast<char>(random.next_uint());
        break;
      case 1:
        text.erase(at, 1 + below(40));
        break;
      case 2:
        text.insert(at, fragments[below(fragments.size())]);
        break;
      default:
        text.insert(below(text.size()), text.substr(at, 1 + below(200)));
    }
  }
  return text;
}

TEST(LoaderMutations, LoadOrThrowAnError) {
  prepare_render_thread();
  const std::string part = "<scene version='3.0.0'><emitter type='constant'/></scene>";
  int loaded = 0;
  constexpr int count = 3000;
  for (uint32_t i = 0; i < count; ++i) {
    RandomStream random(20, i, 0, 0);
    std::string text = good_scene;
    if (i > 0) text = i % 4 < 2 ? with_other_number(text, random) : mutated(text, random);
    const auto files = std::make_shared<MemorySource>(
        std::map<std::string, std::string>{{"scene.xml", text}, {"sub/part.xml", part}});
    LoadOptions options;
    options.lenient = i % 2 == 1;
    try {
      const auto scene = load_scene("scene.xml", files, options);
      ++loaded;
      EXPECT_TRUE(is_finite(scene->bounds.center) && std::isfinite(scene->bounds.radius)) << text;
      for (const Medium& medium : scene->media)
        EXPECT_TRUE(is_finite(medium.sigma_t) && is_finite(medium.albedo)) << text;
      const Ray ray = scene->sensor.sample_ray(scene->film, {0.5f, 0.5f}, {0.3f, 0.7f});
      EXPECT_TRUE(is_finite(ray.origin) && is_finite(ray.direction) && ray.max_distance > 0) << text;
    } catch (const Error& error) {
      EXPECT_FALSE(error.reason().empty());
      EXPECT_NE(error.reason(), "INTERNAL_ERROR") << error.what();
    }
  }
  // The first one is unharmed, and many edits change only a value.
  EXPECT_GT(loaded, count / 20);
  EXPECT_LT(loaded, count);
}

}  // namespace
}  // namespace fogbank::scene::test
