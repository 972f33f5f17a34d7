// The scene language: parameters, includes, references, versions.
#include <gtest/gtest.h>

#include "scene/scene_files.h"
#include "scene/xml/parser.h"

namespace fogbank::scene::test {
namespace {

ParsedScene parse(const std::string& body, const LoadOptions& options = {}, const char* version = "3.0.0") {
  TemporaryFolder folder;
  folder.write("scene.xml", std::string("<scene version='") + version + "'>" + body + "</scene>");
  return parse_scene("scene.xml", *folder.source(), options);
}

template <typename T>
T value(const ParsedScene& scene, std::string_view name, size_t object = 0) {
  const Property* property = scene.objects.at(object)->find(name);
  if (!property) throw std::runtime_error("no property " + std::string(name));
  return std::get<T>(property->value);
}

TEST(LoaderSyntax, ValuesOfEveryType) {
  const ParsedScene scene = parse(R"(<shape type="obj" id="wall">
    <boolean name="a" value="True"/><integer name="b" value="-3"/><float name="c" value="1e-3"/>
    <string name="d" value=" text "/><point name="e" x="1" y="2" z="3"/><vector name="f" value="4, 5, 6"/>
    <rgb name="g" value="0.1 0.2 0.3"/><rgb name="h" value="#ff0000"/><srgb name="i" value="#808080"/>
    <spectrum name="j" value="0.25"/><transform name="k"><translate x="7"/></transform>
    <bsdf type="diffuse"/></shape>)");
  EXPECT_EQ(scene.objects.at(0)->tag, "shape");
  EXPECT_EQ(scene.objects.at(0)->type, "obj");
  EXPECT_EQ(scene.objects.at(0)->id, "wall");
  EXPECT_EQ(scene.objects.at(0)->where.to_string(), "scene.xml:1: <shape type=\"obj\" id=\"wall\">");
  EXPECT_EQ(scene.objects.at(0)->find("j")->where.line, 5);
  EXPECT_TRUE(value<bool>(scene, "a"));
  EXPECT_EQ(value<int64_t>(scene, "b"), -3);
  EXPECT_EQ(value<double>(scene, "c"), 1e-3);
  EXPECT_EQ(value<std::string>(scene, "d"), " text ");
  EXPECT_EQ(value<Vec3d>(scene, "e"), Vec3d(1, 2, 3));
  EXPECT_EQ(value<Vec3d>(scene, "f"), Vec3d(4, 5, 6));
  EXPECT_EQ(value<Spectrum>(scene, "g"), Spectrum(0.1f, 0.2f, 0.3f));
  EXPECT_EQ(value<Spectrum>(scene, "h"), Spectrum(1, 0, 0));
  EXPECT_NEAR(value<Spectrum>(scene, "i").x, 0.2158605f, 1e-6f);
  EXPECT_EQ(value<Spectrum>(scene, "j"), Spectrum(0.25f));
  EXPECT_EQ(value<Mat4d>(scene, "k")[3].x, 7);
  EXPECT_EQ(value<ObjectPointer>(scene, "")->type, "diffuse");
  EXPECT_TRUE(scene.warnings.empty());
}

TEST(LoaderSyntax, SpectraInEmittersAreLight) {
  const ParsedScene scene = parse(R"(<emitter type="area"><spectrum name="radiance" value="2"/></emitter>
    <emitter type="area"><spectrum name="radiance" type="d65"><float name="scale" value="2"/></spectrum></emitter>
    <emitter type="area"><spectrum name="radiance" value="400:1, 700:1"/></emitter>)");
  EXPECT_NEAR(value<Spectrum>(scene, "radiance", 0).x, 2 * 1.2048f, 1e-4f);
  EXPECT_EQ(value<Spectrum>(scene, "radiance", 1), Spectrum(2));
  EXPECT_NEAR(value<Spectrum>(scene, "radiance", 2).x, 1.19969f, 0.015f);
}

TEST(LoaderSyntax, SpectrumFiles) {
  TemporaryFolder folder;
  folder.write(
      "scene.xml",
      "<scene version='3.0.0'><bsdf type='x'><spectrum name='eta' filename='eta.spd'/></bsdf></scene>");
  folder.write("eta.spd", "# nm value\n360 0.4\n 500\t0.4\r\n\n830 0.4\n");
  const ParsedScene scene = parse_scene("scene.xml", *folder.source(), {});
  EXPECT_NEAR(value<Spectrum>(scene, "eta").y, 0.4f, 1e-6f);
}

TEST(LoaderSyntax, ParametersAndDefaults) {
  const std::string body = R"(<default name="width" value="32"/><default name="name" value="mesh"/>
    <default name="name2" value="$name-b"/>
    <film type="hdrfilm"><integer name="width" value="$width"/><string name="s" value="a/$name.$width$name2"/>
    <string name="t" value="$widthpx"/></film>)";
  const ParsedScene scene = parse(body);
  EXPECT_EQ(value<int64_t>(scene, "width"), 32);
  EXPECT_EQ(value<std::string>(scene, "s"), "a/mesh.32mesh-b");
  EXPECT_EQ(value<std::string>(scene, "t"), "32px");
  LoadOptions options;
  options.parameters = {{"width", "64"}};
  EXPECT_EQ(value<int64_t>(parse(body, options), "width"), 64);
}

TEST(LoaderSyntax, ReferencesPointBothWaysAndShare) {
  const ParsedScene scene = parse(R"(<sensor type="perspective"><ref name="medium" id="fog"/></sensor>
    <shape type="cube"><ref name="interior" id="fog"/><ref id="also"/></shape>
    <medium type="homogeneous" id="fog"/>
    <shape type="cube"><bsdf type="diffuse" id="inner"/></shape>
    <alias id="inner" as="also"/>)");
  const auto fog = scene.objects.at(2);
  EXPECT_EQ(value<ObjectPointer>(scene, "medium", 0), fog);
  EXPECT_EQ(value<ObjectPointer>(scene, "interior", 1), fog);
  EXPECT_EQ(value<ObjectPointer>(scene, "", 1), value<ObjectPointer>(scene, "", 3));
}

TEST(LoaderSyntax, Includes) {
  TemporaryFolder folder;
  folder.write("main.xml",
               R"(<scene version="3.0.0"><default name="size" value="5"/><include filename="parts/a.xml"/>
      <include filename="parts/one.xml"/></scene>)");
  // Found relative to the main file, as in Mitsuba, though it stands in parts/a.xml.
  folder.write("parts/a.xml",
               R"(<scene version="3.0.0"><default name="size" value="6"/><default name="other" value="7"/>
      <include filename="parts/b.xml"/></scene>)");
  folder.write("parts/b.xml",
               R"(<scene version="0.6.0"><shape type="cube"><integer name="theSize" value="$size"/>
      <integer name="other" value="$other"/></shape></scene>)");
  folder.write("parts/one.xml", R"(<shape version="3.0.0" type="sphere"/>)");
  const ParsedScene scene = parse_scene("main.xml", *folder.source(), {});
  ASSERT_EQ(scene.objects.size(), 2u);
  EXPECT_EQ(value<int64_t>(scene, "the_size"), 5);  // version 0.6 of that file only
  EXPECT_EQ(value<int64_t>(scene, "other"), 7);
  EXPECT_EQ(scene.objects[0]->where.file, "parts/b.xml");
  EXPECT_EQ(scene.objects[1]->type, "sphere");
}

TEST(LoaderSyntax, SearchFolders) {
  TemporaryFolder folder;
  folder.write("scenes/main.xml", R"(<scene version="3.0.0"><path value="../common"/>
      <include filename="inc/part.xml"/>
      <shape type="obj"><string name="filename" value="a.obj"/></shape>
      <shape type="obj"><string name="filename" value="b.obj"/></shape></scene>)");
  folder.write("common/inc/part.xml", R"(<scene version="3.0.0">
      <shape type="obj"><string name="filename" value="beside.obj"/></shape></scene>)");
  folder.write("common/inc/beside.obj", "")
      .write("scenes/a.obj", "")
      .write("common/a.obj", "")
      .write("common/b.obj", "");
  const ParsedScene scene = parse_scene("scenes/main.xml", *folder.source(), {});
  EXPECT_EQ(value<std::string>(scene, "filename", 0), "common/inc/beside.obj");
  EXPECT_EQ(value<std::string>(scene, "filename", 1), "scenes/a.obj");
  EXPECT_EQ(value<std::string>(scene, "filename", 2), "common/b.obj");
}

TEST(LoaderSyntax, MissingFilesAreAllNoted) {
  TemporaryFolder folder;
  folder.write("main.xml", R"(<scene version="3.0.0"><path value="common"/>
      <shape type="obj"><string name="filename" value="a.obj"/></shape>
      <shape type="obj"><string name="filename" value="b.obj"/></shape></scene>)");
  const auto files = folder.source();
  const Thrown thrown = thrown_by([&] { parse_scene("main.xml", *files, {}); });
  EXPECT_EQ(thrown.reason, "FILE_NOT_FOUND");
  EXPECT_EQ(thrown.message,
            "main.xml:2: <string name=\"filename\">: file 'a.obj' or 'common/a.obj' does not exist");
  EXPECT_EQ(files->missing(), (std::vector<std::string>{"a.obj", "common/a.obj", "b.obj", "common/b.obj"}));
}

TEST(LoaderSyntax, ListOfReferences) {
  TemporaryFolder folder;
  folder.write("main.xml", R"(<scene version="3.0.0"><path value="common"/><include filename="gone.xml"/>
      <include filename="there.xml"/><string name="filename" value="$unknown/x.obj"/>
      <shape type="obj"><string name="filename" value="a.obj"/><ref id="nowhere"/></shape>
      <bsdf type="conductor"><spectrum name="k" filename="k.spd"/></bsdf>
      <shape type="obj"><string name="filename" value="a.obj"/></shape></scene>)");
  folder.write(
      "there.xml",
      R"(<scene version="3.0.0"><shape type="ply"><string name="filename" value="c.ply"/></shape></scene>)");
  folder.write("common/k.spd", "");
  EXPECT_EQ(list_references("main.xml", folder.source(), {}),
            (std::vector<std::string>{"gone.xml", "common/gone.xml", "there.xml", "c.ply", "common/c.ply",
                                      "a.obj", "common/a.obj", "common/k.spd"}));
}

TEST(LoaderSyntax, ByteOrderMarkAndPrologue) {
  TemporaryFolder folder;
  folder.write("main.xml",
               "\xEF\xBB\xBF<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<!-- <scene> -->\n"
               "<!DOCTYPE scene>\n<scene version='3.0.0'>\n<shape type='cube'/></scene>\n<!-- end -->\n");
  EXPECT_EQ(parse_scene("main.xml", *folder.source(), {}).objects.at(0)->where.line, 5);
}

TEST(LoaderSyntax, EntitiesOfXmlItself) {
  EXPECT_EQ(value<std::string>(
                parse(R"(<film type="f"><string name="s" value="&lt;&amp;&#65;&quot;"/></film>)"), "s"),
            "<&A\"");
}

TEST(LoaderSyntax, NoVersionIsReadAsThree) {
  TemporaryFolder folder;
  folder.write("main.xml", "<scene><film type='f'><integer name='aB' value='1'/></film></scene>");
  const ParsedScene scene = parse_scene("main.xml", *folder.source(), {});
  EXPECT_EQ(value<int64_t>(scene, "aB"), 1);
  EXPECT_EQ(scene.warnings,
            std::vector<std::string>{"main.xml:1: <scene>: no 'version' attribute; read as version 3"});
}

TEST(LoaderLegacy, NamesAndLookAt) {
  const ParsedScene scene = parse(R"(<sensor type="perspective"><float name="focusDistance" value="3"/>
    <transform name="toWorld"><lookAt origin="0,0,0" target="0,0,1" up="0,1,0"/></transform></sensor>
    <medium type="homogeneous"><rgb name="sigmaS" value="1"/><rgb name="sigmaA" value="2"/></medium>)",
                                  {}, "0.6.0");
  EXPECT_EQ(value<double>(scene, "focus_distance"), 3);
  EXPECT_EQ(value<Mat4d>(scene, "to_world"), Mat4d(1.0));
  EXPECT_EQ(value<Spectrum>(scene, "sigma_s", 1), Spectrum(1));
  EXPECT_EQ(value<Spectrum>(scene, "sigma_a", 1), Spectrum(2));
}

TEST(LoaderLegacy, TexturePlacement) {
  const ParsedScene scene = parse(R"(<texture type="bitmap"><float name="uscale" value="4"/>
    <float name="voffset" value="0.5"/><string name="filterType" value="ewa"/></texture>)",
                                  {}, "0.5.0");
  const Vec3d moved(value<Mat4d>(scene, "to_uv") * glm::dvec4(1, 1, 0, 1));
  EXPECT_EQ(moved, Vec3d(4, 1.5, 0));
  EXPECT_EQ(scene.objects[0]->find("uscale"), nullptr);
  EXPECT_EQ(value<std::string>(scene, "filter_type"), "bilinear");
  EXPECT_EQ(scene.warnings,
            std::vector<std::string>{
                "scene.xml:2: <string name=\"filter_type\">: filter 'ewa' is replaced by 'bilinear'"});
}

TEST(LoaderLegacy, ShapeWithMediumAndNoBsdfIsABoundary) {
  const std::string body = R"(<medium type="homogeneous" id="fog"/>
    <shape type="cube"><ref name="interior" id="fog"/></shape><shape type="cube"/>
    <shape type="cube"><ref name="interior" id="fog"/><bsdf type="dielectric"/></shape>)";
  const ParsedScene old_scene = parse(body, {}, "0.6.0");
  EXPECT_EQ(value<ObjectPointer>(old_scene, "", 1)->type, "null");
  EXPECT_EQ(old_scene.objects[2]->find(""), nullptr);
  EXPECT_EQ(value<ObjectPointer>(old_scene, "", 3)->type, "dielectric");
  EXPECT_EQ(parse(body, {}, "2.1.0").objects[1]->find(""), nullptr);
}

TEST(LoaderLegacy, FlatSpectraAreGrey) {
  const char* body = R"(<emitter type="area"><spectrum name="radiance" value="16"/></emitter>
    <emitter type="area"><spectrum name="radiance" value="1, 2, 3"/></emitter>)";
  const ParsedScene scene = parse(body, {}, "0.5.0");
  EXPECT_EQ(value<Spectrum>(scene, "radiance", 0), Spectrum(16));
  EXPECT_EQ(value<Spectrum>(scene, "radiance", 1), Spectrum(1, 2, 3));
  EXPECT_EQ(scene.warnings,
            std::vector<std::string>{
                "scene.xml:2: <spectrum name=\"radiance\">: three values are taken as linear sRGB"});
}

TEST(LoaderLenient, UnknownThingsArePassedOverWithAWarning) {
  LoadOptions options;
  options.lenient = true;
  options.parameters = {{"unused", "1"}};
  const ParsedScene scene = parse(R"(<mode value="x"/><shape type="cube" colour="red"><sparkle/>
    <float name="a" value="1"/><float name="a" value="2"/></shape>)",
                                  options);
  EXPECT_EQ(value<double>(scene, "a"), 1);
  EXPECT_EQ(scene.warnings, (std::vector<std::string>{
                                "scene.xml:1: <scene>: parameter 'unused' is not used by the scene",
                                "scene.xml:1: <mode>: unknown element is ignored",
                                "scene.xml:1: <shape type=\"cube\">: unknown attribute 'colour' is ignored",
                                "scene.xml:1: <sparkle>: unknown element is ignored",
                                "scene.xml:2: <float name=\"a\">: given twice; the first one counts"}));
}

}  // namespace
}  // namespace fogbank::scene::test
