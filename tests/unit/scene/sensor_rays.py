"""Prints mitsuba_sensor_rays.h: camera rays of Mitsuba 3.9.1, variant scalar_rgb."""

import mitsuba as mi

mi.set_variant("scalar_rgb")

LOOKAT = '<transform name="to_world"><lookat origin="1, 2, 3" target="-2, 1, 5" up="0.1, 1, 0.2"/></transform>'
SCALED = (
    '<transform name="to_world"><scale x="3" y="2" z="1"/><rotate y="1" angle="30"/>'
    '<translate x="1" y="-2" z="0.5"/></transform>'
)
CROP = (
    '<integer name="crop_offset_x" value="30"/><integer name="crop_offset_y" value="25"/>'
    '<integer name="crop_width" value="20"/><integer name="crop_height" value="10"/>'
)
OFFSET = '<float name="principal_point_offset_x" value="0.1"/><float name="principal_point_offset_y" value="-0.2"/>'
LENS = '<float name="aperture_radius" value="0.3"/><float name="focus_distance" value="5"/>'


def fov(axis: str) -> str:
    return f'<float name="fov" value="40"/><string name="fov_axis" value="{axis}"/>'


CASES = [
    ("perspective", 64, 48, "", fov("x") + LOOKAT),
    ("perspective", 64, 48, "", fov("y") + LOOKAT),
    ("perspective", 64, 48, "", fov("diagonal") + LOOKAT),
    ("perspective", 64, 48, "", fov("smaller") + LOOKAT),
    ("perspective", 64, 48, "", fov("larger") + LOOKAT),
    ("perspective", 48, 64, "", fov("x") + LOOKAT),
    ("perspective", 48, 64, "", fov("y") + LOOKAT),
    ("perspective", 48, 64, "", fov("diagonal") + LOOKAT),
    ("perspective", 48, 64, "", fov("smaller") + LOOKAT),
    ("perspective", 48, 64, "", fov("larger") + LOOKAT),
    ("perspective", 64, 48, "", LOOKAT),
    ("perspective", 64, 48, "", '<string name="focal_length" value="35mm"/>' + LOOKAT),
    ("perspective", 64, 48, "", fov("x") + '<float name="near_clip" value="2"/><float name="far_clip" value="9"/>'),
    ("perspective", 64, 48, CROP, fov("x") + LOOKAT),
    ("perspective", 64, 48, CROP, fov("y") + LOOKAT),
    ("perspective", 64, 48, "", fov("x") + OFFSET),
    ("perspective", 64, 48, CROP, fov("x") + OFFSET),
    ("thinlens", 64, 48, "", fov("x") + LENS + LOOKAT),
    ("thinlens", 64, 48, CROP, fov("larger") + LENS),
    ("orthographic", 64, 48, "", SCALED),
    ("orthographic", 48, 64, CROP.replace("30", "20"), SCALED),
]

SAMPLES = [((0.1, 0.2), (0.3, 0.9)), ((0.85, 0.6), (0.7, 0.25))]


def numbers(values: object) -> str:
    return ", ".join(f"{float(v):.9g}" for v in values)  # type: ignore[attr-defined]


print("// Camera rays of Mitsuba 3.9.1; written by sensor_rays.py, do not edit.")
print("// clang-format off")
print("#pragma once\n")
print('#include "core/vector.h"\n')
print("namespace fogbank::scene::test {\n")
print("/// `position` and `lens` are in [0, 1)^2; `position` is relative to the crop window, as in Mitsuba.")
print("struct MitsubaSensorRay {\n  const char* sensor;\n  Vec2f position;\n  Vec2f lens;\n  Vec3f origin;")
print("  Vec3f direction;\n  float max_distance;\n};\n")
print("inline const MitsubaSensorRay mitsuba_sensor_rays[] = {")
for kind, width, height, crop, parameters in CASES:
    film = (
        f'<film type="hdrfilm"><integer name="width" value="{width}"/>'
        f'<integer name="height" value="{height}"/>{crop}</film>'
    )
    text = f'<sensor type="{kind}">{parameters}{film}</sensor>'
    sensor = mi.load_string(text.replace("<sensor", '<sensor version="3.0.0"', 1))
    for position, lens in SAMPLES:
        ray, _ = sensor.sample_ray(0, 0.5, position, lens)
        print(f'    {{R"({text})",')
        print(f"     {{{numbers(position)}}}, {{{numbers(lens)}}}, {{{numbers(ray.o)}}}, {{{numbers(ray.d)}}},")
        print(f"     {float(ray.maxt):.9g}}},")
print("};\n\n}  // namespace fogbank::scene::test")
