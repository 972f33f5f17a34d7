// From scene files to shapes, media, sensors and defaults.
#include <gtest/gtest.h>

#include "scene/loader.h"
#include "scene/scene_files.h"

namespace fogbank::scene::test {
namespace {

std::shared_ptr<Scene> load(const std::string& body, const char* version = "3.0.0") {
  TemporaryFolder folder;
  folder.write("scene.xml", std::string("<scene version='") + version + "'>" + body + "</scene>");
  folder.write("triangle.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n");
  folder.write("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n");
  prepare_render_thread();
  return load_scene("scene.xml", folder.source(), {});
}

const Mesh& mesh_of(const Scene& scene, size_t shape = 0) {
  return scene.meshes.at(static_cast<size_t>(scene.shapes.at(shape).mesh));
}

/// What a ray from `origin` along `direction` sees.
SurfaceInteraction look(const Scene& scene, const Vec3f& origin, const Vec3f& direction) {
  const Ray ray{origin, direction};
  Hit hit;
  EXPECT_TRUE(scene.intersector->intersect(ray, hit));
  return scene.interaction(ray, hit);
}

void expect_near(const Vec3f& actual, const Vec3f& expected) {
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(actual[axis], expected[axis], 1e-5f) << "axis " << axis;
}

TEST(LoaderShapes, RectangleAndCubeAsMitsuba) {
  // Distances, normals, uv and dp_du of Mitsuba 3.9.1 for the ray from (0.3, 0.2, -5) along +z.
  const Vec3f origin(0.3f, 0.2f, -5);
  const Vec3f along(0, 0, 1);
  const SurfaceInteraction rectangle = look(*load("<shape type='rectangle'/>"), origin, along);
  EXPECT_NEAR(rectangle.distance, 5, 1e-5f);
  expect_near(rectangle.geometric_normal, {0, 0, 1});
  expect_near({rectangle.uv, 0}, {0.65f, 0.6f, 0});
  expect_near(rectangle.dp_du, {2, 0, 0});
  expect_near(rectangle.dp_dv, {0, 2, 0});

  const SurfaceInteraction cube =
      look(*load("<shape type='cube'><boolean name='flip_normals' value='true'/></shape>"), origin, along);
  EXPECT_NEAR(cube.distance, 4, 1e-5f);
  expect_near(cube.geometric_normal, {0, 0, 1});
  expect_near(cube.shading_normal, {0, 0, 1});
  expect_near({cube.uv, 0}, {0.4f, 0.65f, 0});
  expect_near(cube.dp_du, {0, -2, 0});
  expect_near(cube.dp_dv, {2, 0, 0});
}

TEST(LoaderShapes, CubeIsClosedAndFacesOutwards) {
  const auto scene = load("<shape type='cube'/>");
  const Mesh& mesh = mesh_of(*scene);
  EXPECT_EQ(mesh.triangles.size(), 12u);
  // Divergence theorem: the sum of p . (e1 x e2) / 6 is the volume, 8, if all faces look outwards.
  double volume = 0;
  for (const Vec3u& t : mesh.triangles)
    volume += glm::dot(Vec3d(mesh.positions[t.x]),
                       glm::cross(Vec3d(mesh.positions[t.y]), Vec3d(mesh.positions[t.z]))) /
              6;
  EXPECT_NEAR(volume, 8, 1e-12);
}

TEST(LoaderShapes, MirroredMeshesKeepTheirOutside) {
  const auto scene =
      load("<shape type='cube'><transform name='to_world'><scale x='-2'/></transform></shape>");
  const SurfaceInteraction seen = look(*scene, {0.3f, 0.2f, -5}, {0, 0, 1});
  expect_near(seen.geometric_normal, {0, 0, -1});
  expect_near(seen.shading_normal, {0, 0, -1});
}

TEST(LoaderShapes, NormalsFollowByTheInverseTranspose) {
  const auto scene = load(R"(<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="45"/>
      <scale y="3"/></transform></shape>)");
  // z = y turned by 45 degrees, then stretched: the plane z = y / 3.
  expect_near(look(*scene, {0, 0, 5}, {0, 0, -1}).shading_normal, glm::normalize(Vec3f(0, -1, 3)));
}

TEST(LoaderShapes, SphereDiskCylinder) {
  const auto scene = load(R"(<shape type="sphere"><point name="center" x="1" y="2" z="3"/>
      <float name="radius" value="2"/><transform name="to_world"><scale value="3"/></transform></shape>
      <shape type="disk"><transform name="to_world"><translate z="-20"/></transform></shape>
      <shape type="cylinder"><point name="p0" value="100, 0, 0"/><point name="p1" value="100, 0, 4"/>
      <float name="radius" value="0.5"/></shape>)");
  EXPECT_NEAR(look(*scene, {3, 6, -10}, {0, 0, 1}).distance, 13, 1e-5f);  // centre (3, 6, 9), radius 6
  EXPECT_NEAR(look(*scene, {0, 0, -25}, {0, 0, 1}).distance, 5, 1e-5f);
  EXPECT_NEAR(look(*scene, {100, -5, 3.9f}, {0, 1, 0}).distance, 4.5f, 1e-5f);
  EXPECT_EQ(scene->shapes[0].kind, ShapeKind::sphere);
  EXPECT_EQ(scene->shapes[1].kind, ShapeKind::disk);
  EXPECT_EQ(scene->shapes[2].kind, ShapeKind::cylinder);
}

TEST(LoaderShapes, CylinderBetweenTwoPointsAsMitsuba) {
  // Mitsuba 3.9.1: distance, normal, uv and dp_dv.
  const auto scene = load(R"(<shape type="cylinder"><point name="p1" value="1, 2, 3"/>
      <float name="radius" value="0.5"/></shape>)");
  const SurfaceInteraction seen = look(*scene, {0.5f, -5, 1.5f}, {0, 1, 0});
  EXPECT_NEAR(seen.distance, 5.408391952514648f, 1e-5f);
  expect_near(seen.geometric_normal, {0.169031f, -0.845154f, 0.507092f});
  expect_near({seen.uv, 0}, {0.764953f, 0.415485f, 0});
  expect_near(seen.dp_dv, {1, 2, 3});
}

TEST(LoaderShapes, ObjFlipsTextureCoordinatesByDefault) {
  const char* text = "<shape type='obj'><string name='filename' value='triangle.obj'/>%</shape>";
  const auto with = [&](const std::string& extra) {
    std::string body = text;
    return load(body.replace(body.find('%'), 1, extra));
  };
  // Vertex (0, 1) has v = 1 in the file.
  expect_near({look(*with(""), {0.01f, 0.98f, 1}, {0, 0, -1}).uv, 0}, {0.01f, 0.02f, 0});
  expect_near(
      {look(*with("<boolean name='flip_tex_coords' value='false'/>"), {0.01f, 0.98f, 1}, {0, 0, -1}).uv, 0},
      {0.01f, 0.98f, 0});
}

TEST(LoaderShapes, BsdfsAreSharedAndDefaulted) {
  const auto scene = load(R"(<bsdf type="twosided" id="a"><bsdf type="diffuse"/></bsdf>
      <shape type="cube"><ref id="a"/></shape><shape type="cube"><ref id="a"/></shape>
      <shape type="cube"/><shape type="cube"/>)");
  ASSERT_EQ(scene->bsdfs.size(), 2u);
  EXPECT_EQ(scene->shapes[0].bsdf, scene->shapes[1].bsdf);
  EXPECT_EQ(scene->shapes[2].bsdf, scene->shapes[3].bsdf);
  EXPECT_EQ(scene->bsdfs[1]->type, "diffuse");
  EXPECT_TRUE(scene->bsdfs[1]->properties.empty());
}

TEST(LoaderShapes, LightsAreBlackUnlessTheySayOtherwise) {
  const auto scene = load(R"(<shape type="cube"><emitter type="area"/></shape><shape type="cube"/>
      <shape type="cube"><emitter type="area"/><bsdf type="plastic"/></shape>
      <shape type="cube"><emitter type="area"/></shape>)");
  const auto bsdf = [&](size_t shape) { return scene->shapes[shape].bsdf; };
  const ObjectDescription& black = *scene->bsdfs[static_cast<size_t>(bsdf(0))];
  EXPECT_EQ(black.type, "diffuse");
  ASSERT_NE(black.find("reflectance"), nullptr);
  EXPECT_EQ(std::get<double>(black.find("reflectance")->value), 0.0);
  EXPECT_EQ(scene->bsdfs[static_cast<size_t>(bsdf(1))]->find("reflectance"), nullptr);
  EXPECT_EQ(scene->bsdfs[static_cast<size_t>(bsdf(2))]->type, "plastic");
  EXPECT_EQ(bsdf(3), bsdf(0));
}

TEST(LoaderShapes, PassesLight) {
  const auto scene = load(R"(<shape type="cube"><bsdf type="null"/></shape>
      <shape type="cube"><bsdf type="dielectric"/></shape>
      <shape type="cube"><bsdf type="twosided"><bsdf type="mask"><bsdf type="diffuse"/></bsdf></bsdf></shape>
      <shape type="cube"><bsdf type="blendbsdf"><bsdf type="diffuse"/><bsdf type="thindielectric"/></bsdf></shape>
      <shape type="cube"/>)");
  EXPECT_TRUE(scene->shapes[0].passes_light);
  EXPECT_FALSE(scene->shapes[1].passes_light);
  EXPECT_TRUE(scene->shapes[2].passes_light);
  EXPECT_TRUE(scene->shapes[3].passes_light);
  EXPECT_FALSE(scene->shapes[4].passes_light);
}

TEST(LoaderShapes, EmittersOfShapesAndOthers) {
  const auto scene = load(R"(<emitter type="area" id="light"><rgb name="radiance" value="1"/></emitter>
      <emitter type="constant"/>
      <shape type="cube"><ref id="light"/></shape><shape type="sphere"><ref id="light"/></shape>)");
  ASSERT_EQ(scene->emitters.size(), 3u);
  EXPECT_EQ(scene->shapes[0].emitter, 0);
  EXPECT_EQ(scene->shapes[1].emitter, 1);
  EXPECT_EQ(scene->emitters[0], scene->emitters[1]);
  EXPECT_EQ(scene->emitters[2]->type, "constant");
}

TEST(LoaderShapes, GroupsAndInstances) {
  const auto scene =
      load(R"(<shape type="shapegroup" id="group"><shape type="cube"/><shape type="sphere"/></shape>
      <shape type="instance"><ref id="group"/><transform name="to_world"><translate x="10"/></transform></shape>
      <shape type="instance"><ref id="group"/></shape>)");
  EXPECT_EQ(scene->group_count, 1);
  ASSERT_EQ(scene->shapes.size(), 2u);
  EXPECT_EQ(scene->shapes[0].group, 0);
  ASSERT_EQ(scene->instances.size(), 2u);
  EXPECT_EQ(scene->instances[0].to_world[3].x, 10);
  EXPECT_NEAR(look(*scene, {10, 0, -5}, {0, 0, 1}).distance, 4, 1e-5f);
  expect_near(scene->bounds.center, {5, 0, 0});
}

TEST(LoaderShapes, BoundsHoldEverything) {
  const auto scene =
      load(R"(<shape type="rectangle"><transform name="to_world"><translate x="4"/></transform></shape>
      <shape type="sphere"><float name="radius" value="2"/></shape>)");
  expect_near(scene->bounds.center, {1.5f, 0, 0});
  EXPECT_GE(scene->bounds.radius, std::sqrt(3.5f * 3.5f + 2 * 2 + 2 * 2));
  EXPECT_LT(scene->bounds.radius, std::sqrt(3.5f * 3.5f + 2 * 2 + 2 * 2) * 1.001f);
}

TEST(LoaderMedia, Coefficients) {
  const auto scene = load(R"(
      <medium type="homogeneous"><rgb name="sigma_t" value="1, 2, 3"/><rgb name="albedo" value="0.5"/>
        <float name="scale" value="10"/><phase type="hg"/></medium>
      <medium type="homogeneous"/>
      <medium type="homogeneous"><volume name="sigma_t" type="constvolume"><float name="value" value="4"/></volume>
        <volume name="albedo" type="constvolume"><rgb name="value" value="0.1, 0.2, 0.3"/></volume></medium>)");
  ASSERT_EQ(scene->media.size(), 3u);
  expect_near(scene->media[0].sigma_t, {10, 20, 30});
  expect_near(scene->media[0].albedo, {0.5f, 0.5f, 0.5f});
  EXPECT_EQ(scene->media[0].phase->type, "hg");
  expect_near(scene->media[1].sigma_t, {1, 1, 1});
  expect_near(scene->media[1].albedo, {0.75f, 0.75f, 0.75f});
  EXPECT_EQ(scene->media[1].phase, nullptr);
  expect_near(scene->media[2].sigma_t, {4, 4, 4});
  expect_near(scene->media[2].albedo, {0.1f, 0.2f, 0.3f});
}

TEST(LoaderMedia, OldCoefficients) {
  const auto scene = load(R"(<medium type="homogeneous"><rgb name="sigmaS" value="1, 0, 0"/>
      <rgb name="sigmaA" value="3, 2, 0"/><float name="scale" value="2"/></medium>)",
                          "0.6.0");
  expect_near(scene->media[0].sigma_t, {8, 4, 0});
  expect_near(scene->media[0].albedo, {0.25f, 0, 0});
}

TEST(LoaderMedia, AtShapesAndSensor) {
  const auto scene = load(R"(<shape type="cube"><ref name="interior" id="fog"/><bsdf type="null"/></shape>
      <shape type="cube"><ref name="exterior" id="fog"/><medium type="homogeneous" name="interior"/></shape>
      <medium type="homogeneous" id="fog"/><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)");
  ASSERT_EQ(scene->media.size(), 2u);
  const int32_t fog = scene->sensor.medium;
  EXPECT_EQ(scene->media[static_cast<size_t>(fog)].id, "fog");
  EXPECT_TRUE(scene->shapes[0].is_medium_boundary);
  EXPECT_EQ(scene->shapes[0].interior_medium, fog);
  EXPECT_EQ(scene->shapes[0].exterior_medium, none);
  EXPECT_EQ(scene->shapes[1].exterior_medium, fog);
  EXPECT_NE(scene->shapes[1].interior_medium, fog);
}

TEST(LoaderSensor, DefaultsAreMitsubas) {
  const auto scene = load("<sensor type='perspective'/>");
  EXPECT_EQ(scene->film.width, 768);
  EXPECT_EQ(scene->film.height, 576);
  EXPECT_EQ(scene->film.crop, (Window{0, 0, 768, 576}));
  EXPECT_EQ(scene->film.filter, ReconstructionFilter::gaussian);
  EXPECT_EQ(scene->film.filter_stddev, 0.5f);
  EXPECT_EQ(scene->film.filter_radius, 2.0f);
  EXPECT_EQ(scene->sensor.near_clip, 1e-2);
  EXPECT_EQ(scene->sensor.far_clip, 1e4);
  EXPECT_NEAR(scene->sensor.fov_x_degrees(scene->film), 38.18484115600586, 1e-5);  // 50 mm, by Mitsuba 3.9.1
  EXPECT_EQ(scene->sensor.medium, none);
}

TEST(LoaderMedia, FogThatRecordsHoldIsRenderedByThem) {
  const auto integrator = [](const std::string& medium) {
    return load(R"(<integrator type="path"/><medium type="homogeneous" id="fog">)" + medium +
                R"(</medium><sensor type="perspective"><ref name="medium" id="fog"/></sensor>)")
        ->defaults.integrator;
  };
  const auto lobe = [](const std::string& g) {
    return R"(<phase type="hg"><float name="g" value=")" + g + R"("/></phase>)";
  };
  EXPECT_EQ(integrator(""), "radiance-cache");
  EXPECT_EQ(integrator(lobe("0.6")), "radiance-cache");
  EXPECT_EQ(integrator(lobe("-0.3")), "radiance-cache");
  EXPECT_EQ(integrator(lobe("0.61")), "volpath");
  EXPECT_EQ(integrator(R"(<phase type="hg"/>)"), "volpath");
  EXPECT_EQ(integrator(R"(<float name="albedo" value="0"/>)"), "volpath");
  EXPECT_EQ(load("")->defaults.integrator, "volpath");
}

TEST(LoaderSensor, FilmAndSampler) {
  const auto scene = load(R"(<integrator type="volpath"><integer name="max_depth" value="7"/>
      <integer name="rr_depth" value="3"/><boolean name="hide_emitters" value="true"/></integrator>
      <sensor type="thinlens"><float name="aperture_radius" value="0.1"/>
      <sampler type="independent"><integer name="sample_count" value="32"/></sampler>
      <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="32"/>
      <integer name="crop_offset_x" value="10"/><integer name="crop_width" value="20"/>
      <string name="pixel_format" value="rgb"/><rfilter type="tent"/></film></sensor>)");
  EXPECT_EQ(scene->film.crop, (Window{10, 0, 20, 32}));
  EXPECT_EQ(scene->film.filter, ReconstructionFilter::tent);
  EXPECT_EQ(scene->film.filter_radius, 1.0f);
  EXPECT_EQ(scene->sensor.aperture_radius, 0.1);
  EXPECT_EQ(scene->sensor.focus_distance, 1e4);
  EXPECT_EQ(scene->defaults.samples_per_pixel, 32);
  EXPECT_EQ(scene->defaults.max_depth, 7);
  EXPECT_EQ(scene->defaults.rr_depth, 2);  // ours: where roulette starts changes the noise, not the image
  EXPECT_TRUE(scene->defaults.hide_emitters);
  EXPECT_TRUE(scene->warnings.empty());
}

TEST(LoaderSensor, WhatOldScenesSayIsPassedOverAloud) {
  const auto scene = load(R"(<integrator type="sppm"><integer name="maxDepth" value="9"/>
        <integer name="photonCount" value="1"/></integrator>
      <sensor type="perspective"><transform name="toWorld"><scale value="2"/></transform>
      <sampler type="ldsampler"><integer name="sampleCount" value="4"/></sampler>
      <film type="ldrfilm"><boolean name="banner" value="false"/><rfilter type="lanczos"/></film></sensor>
      <sensor type="perspective"/>)",
                          "0.6.0");
  EXPECT_EQ(scene->defaults.max_depth, 9);
  const std::string sampler =
      "scene.xml:4: <sampler type=\"ldsampler\">: sampler 'ldsampler' is replaced by counter-based random "
      "numbers";
  EXPECT_EQ(
      scene->warnings,
      (std::vector<std::string>{
          "scene.xml:1: <integrator type=\"sppm\">: integrator 'sppm' is passed over for the scene's default",
          "scene.xml:5: <film type=\"ldrfilm\">: 'ldrfilm' is read as 'hdrfilm': pixels stay linear",
          "scene.xml:5: <rfilter type=\"lanczos\">: filter 'lanczos' is replaced by 'gaussian'",
          "scene.xml:5: <film type=\"ldrfilm\">: parameter 'banner' is ignored", sampler,
          "scene.xml:3: <sensor type=\"perspective\">: scale factors in the camera's 'to_world' are ignored",
          "scene.xml:6: <sensor type=\"perspective\">: passed over: the scene has a <sensor> already"}));
}

TEST(LoaderSensor, WrappedIntegrators) {
  const auto scene = load(R"(<sensor type="perspective"/><integrator type="moment"><integrator type="path">
      <integer name="max_depth" value="5"/></integrator></integrator>)");
  EXPECT_EQ(scene->defaults.max_depth, 5);
  EXPECT_EQ(scene->warnings, std::vector<std::string>{"scene.xml:1: <integrator type=\"moment\">: integrator "
                                                      "'moment' is passed over for the one within it"});
}

TEST(LoaderLenient, UnknownPluginsAreSubstituted) {
  TemporaryFolder folder;
  folder.write("scene.xml", R"(<scene version="3.0.0"><shape type="torus"/><shape type="cube"/>
      <sensor type="fisheye"><film type="vrfilm"><rfilter type="sinc"/></film></sensor></scene>)");
  LoadOptions options;
  options.lenient = true;
  const auto scene = load_scene("scene.xml", folder.source(), options);
  EXPECT_EQ(scene->shapes.size(), 1u);
  EXPECT_EQ(scene->sensor.kind, SensorKind::perspective);
  EXPECT_EQ(scene->film.filter, ReconstructionFilter::gaussian);
  EXPECT_EQ(scene->warnings,
            (std::vector<std::string>{
                "scene.xml:1: <shape type=\"torus\">: shape 'torus' is left out",
                "scene.xml:2: <sensor type=\"fisheye\">: sensor 'fisheye' is replaced by 'perspective'",
                "scene.xml:2: <film type=\"vrfilm\">: film 'vrfilm' is read as 'hdrfilm'",
                "scene.xml:2: <rfilter type=\"sinc\">: rfilter 'sinc' is replaced by 'gaussian'"}));
}

std::string fingerprint(const std::string& body) { return load(body)->fingerprint; }

TEST(Fingerprint, IsOfTheRadianceFieldOnly) {
  const std::string scene = R"(<bsdf type="diffuse" id="a"><rgb name="reflectance" value="0.5"/></bsdf>
      <shape type="cube" id="b"><ref id="a"/><boolean name="flip_normals" value="true"/></shape>
      <emitter type="constant"/>)";
  const std::string same = R"(<!-- other order, ids, formatting, camera, unused objects -->
      <emitter   type="constant" id="sky"/> <sensor type="orthographic"/> <integrator type="path"/>
      <shape type="cube"><boolean value=" TRUE " name="flip_normals"/>
        <bsdf type="diffuse"><rgb name="reflectance" value=".50 0.5, 5e-1"/></bsdf></shape>
      <bsdf type="plastic" id="unused"/>)";
  const std::string print = fingerprint(scene);
  EXPECT_EQ(print.size(), 64u);
  EXPECT_EQ(print, fingerprint(same));
  EXPECT_NE(print, fingerprint(scene + "<shape type='cube'/>"));
  EXPECT_NE(print, fingerprint(scene + "<emitter type='constant'/>"));
  std::string other = scene;
  EXPECT_NE(print, fingerprint(other.replace(other.find("0.5"), 3, "0.6")));
}

TEST(Fingerprint, DependsOnTheCamerasMedium) {
  const std::string fog = "<shape type='cube'/><medium type='homogeneous' id='fog'/>";
  EXPECT_NE(fingerprint(fog + "<sensor type='perspective'/>"),
            fingerprint(fog + "<sensor type='perspective'><ref id='fog'/></sensor>"));
}

TEST(Fingerprint, DependsOnContentsOfFilesNotNames) {
  const auto print = [](const std::string& name, const std::string& bytes) {
    TemporaryFolder folder;
    folder.write("s.xml", "<scene version='3.0.0'><shape type='obj'><string name='filename' value='" + name +
                              "'/></shape></scene>");
    folder.write(name, bytes);
    return load_scene("s.xml", folder.source(), {})->fingerprint;
  };
  const std::string triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  EXPECT_EQ(print("a.obj", triangle), print("b/c.obj", triangle));
  EXPECT_NE(print("a.obj", triangle), print("a.obj", triangle + "# comment\n"));
}

TEST(FieldIdentity, KeepsEmissionApart) {
  const auto scene = [](const std::string& sky, const std::string& lamp) {
    return load(R"(<shape type="cube"><medium name="interior" type="homogeneous"/></shape>
        <emitter type="constant">)" +
                sky + R"(</emitter>
        <shape type="sphere"><emitter type="area">)" +
                lamp + "</emitter></shape>")
        ->field;
  };
  const FieldIdentity one =
      scene("", "<rgb name='radiance' value='1, 2, 4'/><float name='sampling_weight' value='2'/>");
  EXPECT_EQ(one.transport.size(), 64u);
  ASSERT_EQ(one.emission.size(), 2u);
  EXPECT_EQ(one.emission[0], Spectrum(1, 2, 4)) << "lights of shapes first, as in Scene::emitters";
  EXPECT_EQ(one.emission[1], Spectrum(1));
  const FieldIdentity other =
      scene("<float name='radiance' value='3'/>",
            "<rgb name='radiance' value='2, 1, 1'/><float name='sampling_weight' value='2'/>");
  EXPECT_EQ(one.transport, other.transport);
  EXPECT_EQ(other.emission[1], Spectrum(3));
  EXPECT_NE(
      one.transport,
      scene("", "<rgb name='radiance' value='1, 2, 0'/><float name='sampling_weight' value='2'/>").transport)
      << "what a channel lacks no factor brings";
  EXPECT_NE(one.transport, scene("", "<rgb name='radiance' value='1, 2, 4'/>").transport);
}

TEST(FieldIdentity, FollowsTheOrderOfIndices) {
  const auto transport = [](const std::string& body) { return load(body)->field.transport; };
  const std::string cube = "<shape type='cube'><medium name='interior' type='homogeneous'/></shape>";
  const std::string sphere =
      "<shape type='sphere'><medium name='interior' type='homogeneous'><float name='scale' value='2'/>"
      "</medium></shape>";
  EXPECT_NE(transport(cube + sphere), transport(sphere + cube)) << "records name media by number";
  EXPECT_EQ(transport(cube + sphere),
            transport("<integrator type='path'/>" + cube + "<sensor type='perspective'/>" + sphere));
  EXPECT_NE(transport(cube), transport("<medium type='homogeneous' id='unused'/>" + cube))
      << "a medium more may shift numbers";
}

TEST(Fingerprint, SharedReferencesCostOnce) {
  // 2^40 paths lead to the innermost BSDF.
  std::string body = "<bsdf type='diffuse' id='b0'/>";
  for (int i = 1; i <= 40; ++i) {
    const std::string inner = "<ref id='b" + std::to_string(i - 1) + "'/>";
    body += "<bsdf type='blendbsdf' id='b";
    body += std::to_string(i);
    body += "'>";
    body += inner;
    body += inner;
    body += "</bsdf>";
  }
  EXPECT_EQ(fingerprint(body + "<shape type='cube'><ref id='b40'/></shape>").size(), 64u);
}

}  // namespace
}  // namespace fogbank::scene::test
