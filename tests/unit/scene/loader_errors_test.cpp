// What is wrong with a scene, said in so many words: reason and message of every error of the loader.
#include <gtest/gtest.h>

#include "scene/loader.h"
#include "scene/scene_files.h"

namespace fogbank::scene::test {
namespace {

Thrown load_bytes(const std::string& bytes) {
  TemporaryFolder folder;
  folder.write("s.xml", bytes);
  folder.write("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n");
  folder.write("cycle.xml", "<scene version='3.0.0'>\n<include filename='cycle.xml'/></scene>");
  folder.write("broken.xml", "<scene version='3.0.0'>\n</shape>");
  return thrown_by([&] { load_scene("s.xml", folder.source(), {}); });
}

struct ErrorCase {
  const char* body;
  const char* reason;
  const char* message;
};

std::ostream& operator<<(std::ostream& out, const ErrorCase& error) { return out << error.body; }

class LoaderErrors : public ::testing::TestWithParam<ErrorCase> {};

/// The body stands in line 2 of the file, so that line numbers are not 1 by chance.
TEST_P(LoaderErrors, SayWhatIsWrong) {
  const ErrorCase& expected = GetParam();
  const Thrown thrown = load_bytes(std::string("<scene version='3.0.0'>\n") + expected.body + "</scene>");
  EXPECT_EQ(thrown.reason, expected.reason);
  EXPECT_EQ(thrown.message, expected.message);
}

INSTANTIATE_TEST_SUITE_P(
    Syntax, LoaderErrors,
    ::testing::Values(
        ErrorCase{"<shape type='cube'>", "XML_MALFORMED",
                  "s.xml:2: malformed XML at column 22: Start-end tags mismatch"},
        ErrorCase{"<shape type='cube/>", "XML_MALFORMED",
                  "s.xml:2: malformed XML at column 14: Error parsing element attribute"},
        ErrorCase{"<shape type='a' type='b'/>", "XML_MALFORMED",
                  "s.xml:2: <shape type=\"a\">: attribute 'type' is given twice"},
        ErrorCase{
            "<mode value='1'/>", "UNKNOWN_ELEMENT",
            "s.xml:2: <mode>: unknown element; supported: alias, boolean, bsdf, default, emitter, film, "
            "float, "
            "include, integer, integrator, lookat, matrix, medium, path, phase, point, ref, rfilter, rgb, "
            "rotate, sampler, scale, scene, sensor, shape, spectrum, srgb, string, texture, transform, "
            "translate, vector, volume"},
        ErrorCase{
            "<bdsf type='diffuse'/>", "UNKNOWN_ELEMENT",
            "s.xml:2: <bdsf type=\"diffuse\">: unknown element; supported: alias, boolean, bsdf, default, "
            "emitter, film, float, include, integer, integrator, lookat, matrix, medium, path, phase, point, "
            "ref, rfilter, rgb, rotate, sampler, scale, scene, sensor, shape, spectrum, srgb, string, "
            "texture, "
            "transform, translate, vector, volume; did you mean 'bsdf'?"},
        ErrorCase{"<shape type='cube' colour='red'/>", "UNKNOWN_ATTRIBUTE",
                  "s.xml:2: <shape type=\"cube\">: unknown attribute 'colour'; supported: id, name, type"},
        ErrorCase{"<shape id='x'/>", "MISSING_ATTRIBUTE",
                  "s.xml:2: <shape id=\"x\">: attribute 'type' is missing"},
        ErrorCase{"<float name='x' value='1'/>", "MISPLACED_ELEMENT",
                  "s.xml:2: <float name=\"x\">: may not stand directly in <scene>"},
        ErrorCase{"<shape type='cube'><default name='x' value='1'/></shape>", "MISPLACED_ELEMENT",
                  "s.xml:2: <default name=\"x\">: may only stand directly in <scene>"},
        ErrorCase{"<shape type='cube'><scale x='1'/></shape>", "MISPLACED_ELEMENT",
                  "s.xml:2: <scale>: may not stand in <shape type=\"cube\">"},
        ErrorCase{"<shape type='cube'>\n<float value='1'/></shape>", "MISSING_ATTRIBUTE",
                  "s.xml:3: <float>: attribute 'name' is missing"},
        ErrorCase{"<shape type='cube'>\n<float name='r' value='1,5'/></shape>", "INVALID_VALUE",
                  "s.xml:3: <float name=\"r\">: 'value' must be a number, is '1,5'"},
        ErrorCase{"<shape type='cube'><integer name='r' value='1.5'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <integer name=\"r\">: 'value' must be an integer, is '1.5'"},
        ErrorCase{"<shape type='cube'><boolean name='r' value='yes'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <boolean name=\"r\">: 'value' must be 'true' or 'false', is 'yes'"},
        ErrorCase{"<shape type='cube'><rgb name='r' value='1 2'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <rgb name=\"r\">: 'value' must be one or three numbers or #rrggbb, is '1 2'"},
        ErrorCase{"<shape type='cube'><spectrum name='r' value='500:1, 400:1'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <spectrum name=\"r\">: 'value' must be a number or ascending wavelength:value "
                  "pairs, is "
                  "'500:1, 400:1'"},
        ErrorCase{"<shape type='cube'><spectrum name='r' value='1, 2, 3'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <spectrum name=\"r\">: 'value' must be a number or ascending wavelength:value "
                  "pairs, is "
                  "'1, 2, 3'"},
        ErrorCase{"<shape type='cube'><spectrum name='r' value='400:-1, 500:1'/></shape>", "OUT_OF_RANGE",
                  "s.xml:2: <spectrum name=\"r\">: the spectrum's values must be finite and at least 0"},
        ErrorCase{"<shape type='cube'><spectrum name='r' type='blackbody'/></shape>", "UNKNOWN_PLUGIN",
                  "s.xml:2: <spectrum type=\"blackbody\" name=\"r\">: spectrum 'blackbody' is not supported; "
                  "supported: d65, srgb, uniform"},
        ErrorCase{"<shape type='cube'><float name='r' value='nan'/></shape>", "NOT_FINITE",
                  "s.xml:2: <float name=\"r\">: 'value' must be finite, is 'nan'"},
        ErrorCase{"<shape type='cube'><rgb name='r' value='1 1e39 1'/></shape>", "NOT_FINITE",
                  "s.xml:2: <rgb name=\"r\">: 'value' must be finite, is '1 1e39 1'"},
        ErrorCase{"<shape type='cube'><point name='p' x='inf'/></shape>", "NOT_FINITE",
                  "s.xml:2: <point name=\"p\">: the components must be finite"},
        ErrorCase{"<shape type='cube'><point name='p' x='a'/></shape>", "INVALID_VALUE",
                  "s.xml:2: <point name=\"p\">: 'x' must be a number, is 'a'"},
        ErrorCase{"<shape type='cube'><float name='r' value='1'/>\n<float name='r' value='1'/></shape>",
                  "DUPLICATE_PARAMETER",
                  "s.xml:3: <float name=\"r\">: parameter 'r' is already given in line 2"},
        ErrorCase{"<bsdf type='diffuse' id='a'/>\n<shape type='cube' id='a'/>", "DUPLICATE_ID",
                  "s.xml:3: <shape type=\"cube\" id=\"a\">: id 'a' is already used at s.xml:2"},
        ErrorCase{"<bsdf type='diffuse' id='glass'/><shape type='cube'>\n<ref id='galss'/></shape>",
                  "UNKNOWN_ID",
                  "s.xml:3: <ref id=\"galss\">: there is no object with id 'galss'; did you mean 'glass'?"},
        ErrorCase{"<alias id='x' as='y'/>", "UNKNOWN_ID",
                  "s.xml:2: <alias id=\"x\">: there is no object with id 'x'"},
        ErrorCase{"<bsdf type='twosided' id='a'><ref id='b'/></bsdf><bsdf type='twosided' id='b'>\n<ref "
                  "id='a'/></bsdf>",
                  "REFERENCE_CYCLE", "s.xml:3: <ref id=\"a\">: object 'a' refers to itself"}));

INSTANTIATE_TEST_SUITE_P(
    Files, LoaderErrors,
    ::testing::Values(
        ErrorCase{"<include filename='none.xml'/>", "FILE_NOT_FOUND",
                  "s.xml:2: <include>: file 'none.xml' does not exist"},
        ErrorCase{"<include filename='cycle.xml'/>", "INCLUDE_CYCLE",
                  "cycle.xml:2: <include>: file 'cycle.xml' includes itself"},
        ErrorCase{"<include filename='broken.xml'/>", "XML_MALFORMED",
                  "broken.xml:2: malformed XML at column 3: Start-end tags mismatch"},
        ErrorCase{"<include filename='../x.xml'/>", "PATH_OUTSIDE_ROOT",
                  "s.xml:2: <include>: path '../x.xml' leads out of the scene's root folder"},
        ErrorCase{"<path value='/usr/share'/>", "PATH_OUTSIDE_ROOT",
                  "s.xml:2: <path>: path '/usr/share' is absolute; paths are relative to the scene's folder"},
        ErrorCase{"<shape type='obj'>\n<string name='filename' value='x.obj'/></shape>", "FILE_NOT_FOUND",
                  "s.xml:3: <string name=\"filename\">: file 'x.obj' does not exist"},
        ErrorCase{
            "<shape type='obj'><string name='filename' value='C:\\x.obj'/></shape>", "PATH_OUTSIDE_ROOT",
            "s.xml:2: <string name=\"filename\">: path 'C:\\x.obj' has a scheme or drive; paths are relative "
            "to the scene's folder"},
        ErrorCase{"<shape type='obj'/>", "MISSING_PARAMETER",
                  "s.xml:2: <shape type=\"obj\">: parameter 'filename' is missing"},
        ErrorCase{"<default name='size' value='1'/><film type='hdrfilm'>\n<integer name='width' "
                  "value='$siez'/></film>",
                  "UNDEFINED_PARAMETER",
                  "s.xml:3: <integer name=\"width\">: parameter '$siez' is not defined; defined: size; did "
                  "you mean "
                  "'size'?"},
        ErrorCase{"<default name='a b' value='1'/>", "INVALID_VALUE",
                  "s.xml:2: <default name=\"a b\">: parameter names consist of at most 64 letters, digits "
                  "and '_'"}));

INSTANTIATE_TEST_SUITE_P(
    Transforms, LoaderErrors,
    ::testing::Values(
        ErrorCase{"<shape type='cube'>\n<transform name='to_world'><scale x='0'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:3: <transform name=\"to_world\">: the matrix is singular"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><matrix value='1 2 3 2 4 6 0 0 "
                  "1'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <transform name=\"to_world\">: the matrix is singular"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><scale value='nan'/></transform></shape>",
                  "INVALID_TRANSFORM",
                  "s.xml:2: <transform name=\"to_world\">: the matrix has numbers that are not finite or "
                  "above 1e+15"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><translate x='1e300'/></transform></shape>",
                  "INVALID_TRANSFORM",
                  "s.xml:2: <transform name=\"to_world\">: the matrix has numbers that are not finite or "
                  "above 1e+15"},
        ErrorCase{
            "<shape type='cube'><transform name='to_world'><matrix value='1 0 0 0 0 1 0 0 0 0 1 0 0 0 1 1'/>"
            "</transform></shape>",
            "INVALID_TRANSFORM",
            "s.xml:2: <transform name=\"to_world\">: the matrix is projective: its last row must be 0 0 0 1"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><matrix value='1 2 3'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <matrix>: 'value' must be 16 or 9 numbers, is '1 2 3'"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><rotate angle='3'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <rotate>: the rotation has no axis: give x, y, z or value"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><rotate x='1'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <rotate>: 'angle' must be a number of degrees, is ''"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><lookat origin='0,0,0' "
                  "target='0,0,0'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <lookat>: 'origin' and 'target' coincide"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><lookat origin='0,0,0' "
                  "target='0,1,0'/></transform></shape>",
                  "INVALID_TRANSFORM", "s.xml:2: <lookat>: 'up' is parallel to the view direction"},
        ErrorCase{
            "<shape type='cube'><transform name='to_world'><lookat origin='0,0,0'/></transform></shape>",
            "INVALID_TRANSFORM", "s.xml:2: <lookat>: attribute 'target' is missing"},
        ErrorCase{
            "<shape type='cube'><transform name='to_world'><shear x='1'/></transform></shape>",
            "UNKNOWN_ELEMENT",
            "s.xml:2: <shear>: is no transform step; supported: lookat, matrix, rotate, scale, translate"}));

INSTANTIATE_TEST_SUITE_P(
    Objects, LoaderErrors,
    ::testing::Values(
        ErrorCase{"<shape type='torus'/>", "UNKNOWN_PLUGIN",
                  "s.xml:2: <shape type=\"torus\">: shape 'torus' is not supported; supported: cube, "
                  "cylinder, disk, "
                  "instance, obj, ply, rectangle, serialized, shapegroup, sphere"},
        ErrorCase{"<shape type='cube'>\n<float name='radius' value='1'/></shape>", "UNKNOWN_PARAMETER",
                  "s.xml:3: <shape type=\"cube\">: unknown parameter 'radius'; supported: <bsdf>, <emitter>, "
                  "exterior, flip_normals, interior, to_world"},
        ErrorCase{"<shape type='sphere'><float name='radus' value='1'/></shape>", "UNKNOWN_PARAMETER",
                  "s.xml:2: <shape type=\"sphere\">: unknown parameter 'radus'; supported: <bsdf>, "
                  "<emitter>, center, "
                  "exterior, flip_normals, interior, radius, to_world; did you mean 'radius'?"},
        ErrorCase{"<shape type='sphere'><float name='radius' value='0'/></shape>", "OUT_OF_RANGE",
                  "s.xml:2: <shape type=\"sphere\">: parameter 'radius': must lie in [1e-15, 1e+15], is 0"},
        ErrorCase{
            "<shape type='sphere'><transform name='to_world'><scale x='2'/></transform></shape>",
            "INVALID_TRANSFORM",
            "s.xml:2: <shape type=\"sphere\">: 'to_world' must scale a sphere uniformly; use a mesh for an "
            "ellipsoid"},
        ErrorCase{"<shape type='cylinder'><transform name='to_world'><scale x='2'/></transform></shape>",
                  "INVALID_TRANSFORM",
                  "s.xml:2: <shape type=\"cylinder\">: 'to_world' must keep a cylinder round and straight; "
                  "use a mesh"},
        ErrorCase{"<shape type='cylinder'><point name='p1' value='0'/></shape>", "OUT_OF_RANGE",
                  "s.xml:2: <shape type=\"cylinder\">: 'p0' and 'p1' coincide"},
        ErrorCase{"<shape type='cube'><bsdf type='null'/><bsdf type='null'/></shape>", "DUPLICATE_PARAMETER",
                  "s.xml:2: <shape type=\"cube\">: a shape has one <bsdf>"},
        ErrorCase{"<shape type='cube'><bsdf type='null' name='interior'/></shape>", "WRONG_TYPE",
                  "s.xml:2: <shape type=\"cube\">: parameter 'interior': must be a <medium>, is a <bsdf>"},
        ErrorCase{
            "<shape type='cube'><medium type='homogeneous'/></shape>", "UNKNOWN_PARAMETER",
            "s.xml:2: <shape type=\"cube\">: unexpected <medium type=\"homogeneous\">; supported: <bsdf>, "
            "<emitter>, exterior, flip_normals, interior, to_world"},
        ErrorCase{"<shape type='obj'><string name='filename' value='line.obj'/></shape>", "EMPTY_MESH",
                  "s.xml:2: <shape type=\"obj\">: line.obj: none of its 1 triangles has an area"},
        ErrorCase{
            "<shape type='rectangle'><transform name='to_world'><scale value='1e-30'/></transform><emitter "
            "type='area'/></shape>",
            "ZERO_AREA_LIGHT",
            "s.xml:2: <shape type=\"rectangle\">: the shape is a light and has (almost) no area"},
        ErrorCase{
            "<shape type='sphere'><float name='radius' value='1e-15'/><transform name='to_world'><scale "
            "value='1e-10'/></transform><emitter type='area'/></shape>",
            "ZERO_AREA_LIGHT",
            "s.xml:2: <shape type=\"sphere\">: the shape is a light and has (almost) no area"},
        ErrorCase{"<shape type='cube'><transform name='to_world'><scale value='1e10'/><translate "
                  "x='1e15'/></transform></shape>",
                  "COORDINATE_TOO_LARGE", "s.xml:2: <shape type=\"cube\">: the shape extends beyond 1e+15"},
        ErrorCase{"<shape type='cylinder'><point name='p1' value='0, 1, 3e38'/></shape>",
                  "COORDINATE_TOO_LARGE",
                  "s.xml:2: <shape type=\"cylinder\">: the shape extends beyond 1e+15"},
        ErrorCase{"<shape type='shapegroup' id='g'><shape type='sphere'><float name='radius' "
                  "value='1e15'/></shape></shape><shape type='instance'><ref id='g'/><transform "
                  "name='to_world'><scale "
                  "value='1e10'/></transform></shape>",
                  "COORDINATE_TOO_LARGE", "the scene's instances extend beyond 1e+15"},
        ErrorCase{"<shape type='shapegroup'/>", "EMPTY_GROUP",
                  "s.xml:2: <shape type=\"shapegroup\">: a shapegroup needs at least one <shape>"},
        ErrorCase{"<shape type='instance'/>", "MISSING_PARAMETER",
                  "s.xml:2: <shape type=\"instance\">: an instance needs one reference to a shapegroup"},
        ErrorCase{"<shape type='shapegroup'><shape type='shapegroup'/></shape>",
                  "NESTED_INSTANCES_UNSUPPORTED",
                  "s.xml:2: <shape type=\"shapegroup\">: instances within a shapegroup are not supported"},
        ErrorCase{"<shape type='shapegroup'><shape type='cube'><emitter type='area'/></shape></shape>",
                  "INSTANCED_EMITTER_UNSUPPORTED",
                  "s.xml:2: <emitter type=\"area\">: shapes in a shapegroup can't be lights"}));

INSTANTIATE_TEST_SUITE_P(
    Media, LoaderErrors,
    ::testing::Values(
        ErrorCase{"<medium type='heterogeneous'/>", "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
                  "s.xml:2: <medium type=\"heterogeneous\">: heterogeneous media ('heterogeneous') are not "
                  "supported "
                  "yet; supported: homogeneous, with constvolume at most"},
        ErrorCase{"<medium type='homogeneous'>\n<volume type='gridvolume' name='albedo'/></medium>",
                  "HETEROGENEOUS_MEDIUM_UNSUPPORTED",
                  "s.xml:3: <volume type=\"gridvolume\" name=\"albedo\">: heterogeneous media ('gridvolume') "
                  "are not "
                  "supported yet; supported: homogeneous, with constvolume at most"},
        ErrorCase{"<medium type='fog'/>", "UNKNOWN_PLUGIN",
                  "s.xml:2: <medium type=\"fog\">: medium 'fog' is not supported; supported: homogeneous"},
        ErrorCase{
            "<medium type='homogeneous'>\n<rgb name='sigma_t' value='1, -1, 1'/></medium>", "OUT_OF_RANGE",
            "s.xml:3: <medium type=\"homogeneous\">: parameter 'sigma_t': must lie in [0, 1e+10], is -1"},
        ErrorCase{"<medium type='homogeneous'><rgb name='albedo' value='1.5'/></medium>", "OUT_OF_RANGE",
                  "s.xml:2: <medium type=\"homogeneous\">: parameter 'albedo': must lie in [0, 1], is 1.5"},
        ErrorCase{"<medium type='homogeneous'><rgb name='sigma_t' value='nan'/></medium>", "NOT_FINITE",
                  "s.xml:2: <rgb name=\"sigma_t\">: 'value' must be finite, is 'nan'"},
        ErrorCase{
            "<medium type='homogeneous'><float name='scale' value='1e308'/></medium>", "OUT_OF_RANGE",
            "s.xml:2: <medium type=\"homogeneous\">: parameter 'scale': must lie in [0, 1e+10], is 1e+308"},
        ErrorCase{
            "<medium type='homogeneous'><rgb name='sigma_s' value='1'/><rgb name='albedo' "
            "value='1'/></medium>",
            "CONFLICTING_PARAMETERS",
            "s.xml:2: <medium type=\"homogeneous\">: give either 'sigma_t' and 'albedo' or 'sigma_s' and "
            "'sigma_a', not both"},
        ErrorCase{"<medium type='homogeneous'><phase type='hg'/><phase type='hg'/></medium>",
                  "DUPLICATE_PARAMETER", "s.xml:2: <medium type=\"homogeneous\">: a medium has one <phase>"},
        ErrorCase{
            "<medium type='homogeneous'><rgb name='sigmaT' value='1'/></medium>", "UNKNOWN_PARAMETER",
            "s.xml:2: <medium type=\"homogeneous\">: unknown parameter 'sigmaT'; supported: <phase>, albedo, "
            "scale, sigma_t; did you mean 'sigma_t'?"}));

INSTANTIATE_TEST_SUITE_P(
    Sensors, LoaderErrors,
    ::testing::Values(
        ErrorCase{
            "<sensor type='fisheye'/>", "UNKNOWN_PLUGIN",
            "s.xml:2: <sensor type=\"fisheye\">: sensor 'fisheye' is not supported; supported: orthographic, "
            "perspective, thinlens"},
        ErrorCase{
            "<sensor type='perspective'><float name='fov' value='180'/></sensor>", "OUT_OF_RANGE",
            "s.xml:2: <sensor type=\"perspective\">: the horizontal field of view must lie between 0 and 180 "
            "degrees, is 180"},
        ErrorCase{
            "<sensor type='perspective'><float name='fov' value='0'/></sensor>", "OUT_OF_RANGE",
            "s.xml:2: <sensor type=\"perspective\">: the horizontal field of view must lie between 0 and 180 "
            "degrees, is 0"},
        ErrorCase{"<sensor type='perspective'><float name='fov' value='200'/></sensor>", "OUT_OF_RANGE",
                  "s.xml:2: <sensor type=\"perspective\">: parameter 'fov': must lie in [0, 180], is 200"},
        ErrorCase{
            "<sensor type='perspective'><string name='fov_axis' value='z'/></sensor>", "UNKNOWN_CHOICE",
            "s.xml:2: <sensor type=\"perspective\">: parameter 'fov_axis': 'z' is not supported; supported: "
            "diagonal, larger, smaller, x, y"},
        ErrorCase{"<sensor type='perspective'><float name='fov' value='20'/><string name='focal_length' "
                  "value='50mm'/></sensor>",
                  "CONFLICTING_PARAMETERS",
                  "s.xml:2: <sensor type=\"perspective\">: give either 'fov' or 'focal_length', not both"},
        ErrorCase{"<sensor type='perspective'><string name='focal_length' value='2in'/></sensor>",
                  "INVALID_VALUE",
                  "s.xml:2: <sensor type=\"perspective\">: parameter 'focal_length': must be a length such "
                  "as '50mm', "
                  "is '2in'"},
        ErrorCase{"<sensor type='perspective'><float name='near_clip' value='5'/><float name='far_clip' "
                  "value='2'/></sensor>",
                  "OUT_OF_RANGE",
                  "s.xml:2: <sensor type=\"perspective\">: 'near_clip' must be below 'far_clip'"},
        ErrorCase{"<sensor type='thinlens'/>", "MISSING_PARAMETER",
                  "s.xml:2: <sensor type=\"thinlens\">: parameter 'aperture_radius' is missing"},
        ErrorCase{"<sensor type='perspective'><film type='hdrfilm'>\n<integer name='width' "
                  "value='0'/></film></sensor>",
                  "OUT_OF_RANGE",
                  "s.xml:3: <film type=\"hdrfilm\">: parameter 'width': must lie in [1, 16384], is 0"},
        ErrorCase{"<sensor type='perspective'><film type='hdrfilm'><integer name='height' "
                  "value='100000'/></film></sensor>",
                  "OUT_OF_RANGE",
                  "s.xml:2: <film type=\"hdrfilm\">: parameter 'height': must lie in [1, 16384], is 100000"},
        ErrorCase{"<sensor type='perspective'><film type='hdrfilm'><integer name='crop_offset_x' "
                  "value='1'/></film></sensor>",
                  "CROP_OUTSIDE_FILM",
                  "s.xml:2: <film type=\"hdrfilm\">: the crop window, 768 x 576 at (1, 0), leaves the film "
                  "of 768 x "
                  "576"},
        ErrorCase{"<sensor type='perspective'><film type='vrfilm'/></sensor>", "UNKNOWN_PLUGIN",
                  "s.xml:2: <film type=\"vrfilm\">: film 'vrfilm' is not supported; supported: hdrfilm; did "
                  "you mean 'hdrfilm'?"},
        ErrorCase{"<sensor type='perspective'><film type='hdrfilm'><rfilter type='sinc'/></film></sensor>",
                  "UNKNOWN_PLUGIN",
                  "s.xml:2: <rfilter type=\"sinc\">: rfilter 'sinc' is not supported; supported: box, "
                  "gaussian, tent"},
        ErrorCase{"<sensor type='perspective'><sampler type='independent'><integer name='sample_count' "
                  "value='0'/></sampler></sensor>",
                  "OUT_OF_RANGE",
                  "s.xml:2: <sampler type=\"independent\">: parameter 'sample_count': must lie in [1, "
                  "1048576], is 0"},
        ErrorCase{
            "<integrator type='volpath'><integer name='max_depth' value='-2'/></integrator>", "OUT_OF_RANGE",
            "s.xml:2: <integrator type=\"volpath\">: parameter 'max_depth': must lie in [-1, 2147483647], is "
            "-2"}));

struct FileCase {
  const char* name;
  std::string bytes;
  const char* reason;
  const char* message;
};

std::string utf16(const std::string& text, bool is_big_endian) {
  std::string bytes = is_big_endian ? "\xFE\xFF" : "\xFF\xFE";
  for (const char c : text) {
    if (is_big_endian) bytes += '\0';
    bytes += c;
    if (!is_big_endian) bytes += '\0';
  }
  return bytes;
}

TEST(LoaderFileErrors, SayWhatIsWrong) {
  const std::string scene = "<scene version='3.0.0'></scene>";
  std::string bomb = "<!DOCTYPE scene [<!ENTITY a0 'ha'>";
  for (int i = 1; i <= 12; ++i) {
    bomb += "<!ENTITY a" + std::to_string(i) + " '";
    for (int k = 0; k < 10; ++k) bomb += "&a" + std::to_string(i - 1) + ";";
    bomb += "'>";
  }
  bomb += "]>\n<scene version='3.0.0'><shape type='&a12;'/></scene>";
  std::string deep;
  for (int i = 0; i < 5'000'000; ++i) deep += "<a>";
  std::string many = "<scene version='3.0.0'>";
  for (int i = 0; i < 1'000'000; ++i) many += "<a/>";
  const char* not_utf8 = "s.xml: the file is not UTF-8 (it looks like UTF-16 or UTF-32); save it as UTF-8";
  const FileCase cases[] = {
      {"empty", "", "XML_MALFORMED", "s.xml:1: malformed XML at column 1: No document element found"},
      {"blank", " \n\n ", "XML_MALFORMED", "s.xml:3: malformed XML at column 2: No document element found"},
      {"text", "hello", "XML_MALFORMED", "s.xml:1: malformed XML at column 6: No document element found"},
      {"two roots", scene + "\n" + scene, "XML_MALFORMED", "s.xml:2: a second root element <scene>"},
      {"other root", "<html/>", "NOT_A_SCENE", "s.xml:1: <html>: the root element must be <scene>"},
      {"version", "<scene version='4.0.0'/>", "UNSUPPORTED_VERSION",
       "s.xml:1: <scene>: version '4.0.0' is not supported; supported: 0.x, 2.x, 3.x"},
      {"no version", "<scene version='new'/>", "UNSUPPORTED_VERSION",
       "s.xml:1: <scene>: version 'new' is not supported; supported: 0.x, 2.x, 3.x"},
      {"scene attribute", "<scene version='3.0.0' unit='m'/>", "UNKNOWN_ATTRIBUTE",
       "s.xml:1: <scene>: unknown attribute 'unit'; supported: version"},
      {"unclosed comment", "<scene version='3.0.0'>\n<!-- </scene>", "XML_MALFORMED",
       "s.xml:2: malformed XML at column 13: Error parsing comment"},
      {"unclosed CDATA", "<scene version='3.0.0'><![CDATA[ </scene>", "XML_MALFORMED",
       "s.xml:1: malformed XML at column 33: Error parsing CDATA section"},
      {"entity bomb", bomb, "XML_DOCTYPE_REFUSED",
       "s.xml:1: document type declarations and entities are not read"},
      {"external entity", "<!DOCTYPE s [<!ENTITY x SYSTEM 'file:///etc/passwd'>]>\n" + scene,
       "XML_DOCTYPE_REFUSED", "s.xml:1: document type declarations and entities are not read"},
      {"deep", deep, "XML_TOO_DEEP", "s.xml:1: elements are nested more than 64 deep"},
      {"many", many + "</scene>", "XML_TOO_MANY_ELEMENTS", "s.xml:1: more than 1000000 elements"},
      // NOLINTNEXTLINE(bugprone-string-constructor): it is meant to be large
      {"100 MB attribute", "<scene version='" + std::string(100'000'000, '3') + "'/>", "XML_TOO_LARGE",
       "s.xml: the file has 100000019 bytes; at most 67108864 are read"},
      {"2 MiB attribute", "<scene version='" + std::string(2 << 20, '3') + "'/>", "XML_ATTRIBUTE_TOO_LONG",
       "s.xml:1: an attribute has 2097152 bytes; at most 1048576 are read"},
      {"NUL", std::string("<scene version='3.0.0'>\n<a b='\0'/></scene>", 41), "XML_ENCODING",
       "s.xml:2: a NUL byte is not text"},
      {"UTF-16 LE", utf16(scene, false), "XML_ENCODING", not_utf8},
      {"UTF-16 BE", utf16(scene, true), "XML_ENCODING", not_utf8},
      {"UTF-16 LE, no mark", utf16(scene, false).substr(2), "XML_ENCODING", not_utf8},
      {"UTF-32", std::string("\0\0\xFE\xFF\0\0\0<", 8), "XML_ENCODING", not_utf8},
      {"Latin 1", "<scene version='3.0.0'><!-- \xFC --></scene>", "XML_ENCODING",
       "s.xml: the file is not valid UTF-8"},
      {"overlong", "<scene version='3.0.0'><!-- \xC0\xBC --></scene>", "XML_ENCODING",
       "s.xml: the file is not valid UTF-8"},
  };
  for (const FileCase& expected : cases) {
    SCOPED_TRACE(expected.name);
    const Thrown thrown = load_bytes(expected.bytes);
    EXPECT_EQ(thrown.reason, expected.reason);
    EXPECT_EQ(thrown.message, expected.message);
  }
}

TEST(LoaderFileErrors, DeclaredButHarmlessDoctypeAndUndefinedEntities) {
  EXPECT_EQ(load_bytes("<!DOCTYPE scene SYSTEM 'http://localhost/x.dtd'>\n<scene version='3.0.0'/>").reason,
            "");
  // An entity that isn't XML's own stays as it is written: nothing is looked up.
  EXPECT_EQ(load_bytes("<scene version='3.0.0'><shape type='&passwd;'/></scene>").message,
            "s.xml:1: <shape type=\"&passwd;\">: shape '&passwd;' is not supported; supported: cube, "
            "cylinder, disk, "
            "instance, obj, ply, rectangle, serialized, shapegroup, sphere");
}

TEST(LoaderFileErrors, DepthThroughIncludesAndReferences) {
  TemporaryFolder folder;
  std::string open;
  std::string close;
  for (int i = 0; i < 40; ++i) {
    open += "<bsdf type='twosided'>";
    close += "</bsdf>";
  }
  folder.write("s.xml",
               "<scene version='3.0.0'>" + open + "<include filename='i.xml'/>" + close + "</scene>");
  folder.write("i.xml", "<scene version='3.0.0'>" + open + close + "</scene>");
  const Thrown nested = thrown_by([&] { load_scene("s.xml", folder.source(), {}); });
  EXPECT_EQ(nested.reason, "XML_TOO_DEEP");

  std::string chain = "<bsdf type='diffuse' id='b0'/>";
  for (int i = 1; i <= 100; ++i)
    chain += "<bsdf type='twosided' id='b" + std::to_string(i) + "'><ref id='b" + std::to_string(i - 1) +
             "'/></bsdf>";
  // Defined in this order each is built before it is referred to; from the end, all at once.
  EXPECT_EQ(load_bytes("<scene version='3.0.0'>" + chain + "</scene>").reason, "XML_TOO_DEEP");
  EXPECT_EQ(
      load_bytes("<scene version='3.0.0'><shape type='cube'><ref id='b100'/></shape>" + chain + "</scene>")
          .reason,
      "XML_TOO_DEEP");
}

TEST(LoaderFileErrors, TooManyIncludes) {
  TemporaryFolder folder;
  std::string body = "<scene version='3.0.0'>";
  for (int i = 0; i < 65; ++i) body += "<include filename='i.xml'/>";
  folder.write("s.xml", body + "</scene>").write("i.xml", "<scene version='3.0.0'/>");
  const Thrown thrown = thrown_by([&] { load_scene("s.xml", folder.source(), {}); });
  EXPECT_EQ(thrown.reason, "TOO_MANY_INCLUDES");
  EXPECT_EQ(thrown.message, "s.xml:1: <include>: more than 64 files are included");
}

TEST(LoaderFileErrors, ParametersThatMultiply) {
  std::string body = "<default name='a0' value='" + std::string(1000, 'x') + "'/>";
  for (int i = 1; i <= 12; ++i) {
    body += "<default name='a" + std::to_string(i) + "' value='";
    for (int k = 0; k < 10; ++k) body += "$a" + std::to_string(i - 1);
    body += "'/>";
  }
  EXPECT_EQ(load_bytes("<scene version='3.0.0'>" + body + "</scene>").reason, "XML_ATTRIBUTE_TOO_LONG");
}

TEST(LoaderFileErrors, UnusedParameters) {
  TemporaryFolder folder;
  folder.write("s.xml", "<scene version='3.0.0'/>");
  LoadOptions options;
  options.parameters = {{"spp", "1"}};
  const Thrown thrown = thrown_by([&] { load_scene("s.xml", folder.source(), options); });
  EXPECT_EQ(thrown.reason, "UNUSED_PARAMETER");
  EXPECT_EQ(thrown.message, "s.xml:1: <scene>: parameter 'spp' is not used by the scene");
}

TEST(LoaderFileErrors, TheMainFileItself) {
  TemporaryFolder folder;
  EXPECT_EQ(thrown_by([&] { load_scene("none.xml", folder.source(), {}); }).message,
            "none.xml: file 'none.xml' does not exist");
  EXPECT_EQ(thrown_by([&] { load_scene("../s.xml", folder.source(), {}); }).reason, "PATH_OUTSIDE_ROOT");
}

}  // namespace
}  // namespace fogbank::scene::test
