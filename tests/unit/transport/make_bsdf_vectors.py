"""Writes bsdf_vectors.json: what Mitsuba 3.9.1 (scalar_rgb) says about every BSDF.

Run it from the repository's root with the pinned Mitsuba of pyproject.toml:

    python tests/unit/transport/make_bsdf_vectors.py

The table holds, for each case: the BSDF's description; pairs of directions (wo to the viewer, wi to
the light, local) with f |cos theta_i| and density; draws from delta lobes; null transmission. Numbers
are float32 in the shortest form that reads back the same, because the density of a sharp lobe
amplifies any rounding of its directions. Directions are drawn from a fixed seed: half of the wi by
Mitsuba's own sampling, so that peaks are hit, half uniformly.
"""

from __future__ import annotations

import base64
import json
import math
import pathlib
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterable
from typing import Any

import mitsuba as mi
import numpy as np

PAIRS = 24
DELTA_DIRECTIONS = 4
NULL_DIRECTIONS = 3
OUTPUT = pathlib.Path(__file__).with_name("bsdf_vectors.json")

# A surface whose parametrisation is neither orthogonal nor of unit speed.
DP_DU = [1.5, 0.0, 0.0]
DP_DV = [0.25, 0.75, 0.0]
UV = [0.4, 0.55]

Description = dict[str, Any]
Value = float | bool | str | list[float]


def bsdf(kind: str, *nested: Description, **parameters: Value) -> Description:
    description: Description = {"type": kind, "parameters": parameters}
    if nested:
        description["nested"] = list(nested)
    return description


def png(colour_type: int, texel: Callable[[int, int], list[int]]) -> bytes:
    """8 x 8 picture; `texel` gives the channels of column x, row y (from the top)."""
    rows = b"".join(bytes([0] + [value for x in range(8) for value in texel(x, y)]) for y in range(8))

    def chunk(tag: bytes, data: bytes) -> bytes:
        body = tag + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    header = struct.pack(">IIBBBBB", 8, 8, 8, colour_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


PICTURES = {
    # Neither slope of the ramp is that of the other axis, so that swapped or turned axes show.
    "ramp.png": png(0, lambda x, y: [120 + 9 * x - 16 * y]),
    "normals.png": png(2, lambda x, y: [100 + 8 * x, 170 - 9 * y, 220]),
}

RED = [0.8, 0.3, 0.1]
BLUE = [0.1, 0.4, 0.9]
DIFFUSE = bsdf("diffuse", reflectance=RED)
GLOSS = bsdf("roughconductor", material="Cu", alpha=0.2, distribution="ggx")

CASES: dict[str, Description] = {
    "diffuse": DIFFUSE,
    "diffuse_default": bsdf("diffuse"),
    "twosided_one": bsdf("twosided", DIFFUSE),
    "twosided_two": bsdf("twosided", DIFFUSE, GLOSS),
    "null": bsdf("null"),
    "dielectric": bsdf("dielectric"),
    "dielectric_water": bsdf(
        "dielectric", int_ior="Water", ext_ior=1.0, specular_reflectance=BLUE, specular_transmittance=RED
    ),
    "dielectric_inverted": bsdf("dielectric", int_ior=1.0, ext_ior="diamond"),
    "thindielectric": bsdf("thindielectric"),
    "thindielectric_tinted": bsdf("thindielectric", int_ior=1.8, specular_reflectance=BLUE, specular_transmittance=RED),
    "conductor_none": bsdf("conductor"),
    "conductor_gold": bsdf("conductor", material="Au", specular_reflectance=0.9),
    "conductor_eta_k": bsdf("conductor", eta=[0.2, 0.9, 1.1], k=[3.9, 2.5, 2.1]),
    "roughconductor": bsdf("roughconductor"),
    "roughconductor_ggx": bsdf("roughconductor", material="Al", alpha=0.3, distribution="ggx"),
    "roughconductor_anisotropic": bsdf(
        "roughconductor", material="Au", alpha_u=0.1, alpha_v=0.4, distribution="beckmann"
    ),
    "roughconductor_anisotropic_ggx": bsdf(
        "roughconductor", material="Cr", alpha_u=0.5, alpha_v=0.15, distribution="ggx"
    ),
    "roughdielectric": bsdf("roughdielectric"),
    "roughdielectric_ggx": bsdf(
        "roughdielectric", alpha=0.4, distribution="ggx", int_ior=1.8, specular_transmittance=RED
    ),
    "roughdielectric_anisotropic": bsdf("roughdielectric", alpha_u=0.3, alpha_v=0.6, int_ior=1.33),
    "plastic": bsdf("plastic"),
    "plastic_nonlinear": bsdf(
        "plastic", diffuse_reflectance=RED, specular_reflectance=0.7, nonlinear=True, int_ior=1.9
    ),
    "roughplastic": bsdf("roughplastic"),
    "roughplastic_ggx": bsdf("roughplastic", distribution="ggx", alpha=0.3, diffuse_reflectance=RED, int_ior=1.6),
    "roughplastic_nonlinear": bsdf(
        "roughplastic", alpha=0.5, diffuse_reflectance=RED, specular_reflectance=BLUE, nonlinear=True
    ),
    "mask": bsdf("mask", DIFFUSE),
    "mask_opacity": bsdf("mask", bsdf("thindielectric"), opacity=0.3),
    "blendbsdf": bsdf("blendbsdf", DIFFUSE, GLOSS, weight=0.35),
    "normalmap": bsdf("normalmap", GLOSS, normalmap=[0.62, 0.41, 0.93]),
    "diffuse_textured": bsdf("diffuse", reflectance="ramp.png"),
    "roughconductor_textured": bsdf("roughconductor", alpha="ramp.png", specular_reflectance="ramp.png"),
    "roughdielectric_textured": bsdf("roughdielectric", alpha_u="ramp.png", alpha_v=0.2, distribution="ggx"),
    "mask_textured": bsdf("mask", DIFFUSE, opacity="ramp.png"),
    "blendbsdf_textured": bsdf("blendbsdf", DIFFUSE, GLOSS, weight="ramp.png"),
    "normalmap_textured": bsdf("normalmap", DIFFUSE, normalmap="normals.png"),
    "principled_textured": bsdf(
        "principled", base_color="ramp.png", roughness="ramp.png", metallic="ramp.png", sheen="ramp.png"
    ),
    "normalmap_plain": bsdf(
        "normalmap",
        DIFFUSE,
        normalmap=[0.25, 0.6, 0.8],
        flip_invalid_normals=False,
        use_shadowing_function=False,
    ),
    "bumpmap": bsdf("bumpmap", bsdf("diffuse", reflectance=0.7), scale=0.5, height="ramp.png"),
    "principled": bsdf("principled"),
    "principled_metal": bsdf(
        "principled", base_color=RED, metallic=0.9, roughness=0.4, anisotropic=0.6, specular=0.7, spec_tint=0.5
    ),
    "principled_cloth": bsdf("principled", base_color=BLUE, roughness=0.8, sheen=0.8, sheen_tint=0.6, flatness=0.7),
    "principled_coat": bsdf(
        "principled", base_color=RED, roughness=0.5, clearcoat=0.9, clearcoat_gloss=0.4, spec_tint=1.0
    ),
    "principled_glass": bsdf(
        "principled", base_color=[0.9, 0.8, 0.7], spec_trans=0.8, eta=1.5, roughness=0.5, clearcoat=0.5
    ),
}


def plugin(description: Description, folder: pathlib.Path) -> dict[str, Any]:
    """The dictionary that Mitsuba loads."""
    result: dict[str, Any] = {"type": description["type"]}
    for name, value in description["parameters"].items():
        if isinstance(value, list):
            result[name] = {"type": "rgb", "value": value}
        elif isinstance(value, str) and value.endswith(".png"):
            result[name] = {"type": "bitmap", "filename": str(folder / value), "raw": True}
        else:
            result[name] = value
    for index, nested in enumerate(description.get("nested", [])):
        result[f"nested_{index}"] = plugin(nested, folder)
    return result


def shortest(values: Iterable[float]) -> list[float]:
    """float32 values as the shortest decimals that read back the same."""
    return [float(str(np.float32(value))) for value in values]


def point(wo: list[float]) -> mi.SurfaceInteraction3f:
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(wo)
    interaction.n = mi.Normal3f(0, 0, 1)
    interaction.sh_frame = mi.Frame3f(mi.Vector3f(1, 0, 0), mi.Vector3f(0, 1, 0), mi.Vector3f(0, 0, 1))
    interaction.dp_du = mi.Vector3f(DP_DU)
    interaction.dp_dv = mi.Vector3f(DP_DV)
    interaction.uv = mi.Point2f(UV)
    return interaction


def direction(random: np.random.Generator, lowest_cosine: float = -1.0) -> list[float]:
    z = random.uniform(lowest_cosine, 1.0)
    azimuth = random.uniform(0.0, 2.0 * math.pi)
    sine = math.sqrt(1.0 - z * z)
    return shortest([sine * math.cos(azimuth), sine * math.sin(azimuth), z])


def measure(name: str, description: Description, folder: pathlib.Path) -> dict[str, Any]:
    random = np.random.default_rng(zlib.crc32(name.encode()))
    model = mi.load_dict(plugin(description, folder))
    context = mi.BSDFContext()
    smooth = mi.has_flag(model.flags(), mi.BSDFFlags.Smooth)
    delta = mi.has_flag(model.flags(), mi.BSDFFlags.Delta) or mi.has_flag(model.flags(), mi.BSDFFlags.Null)
    case: dict[str, Any] = {"name": name, "bsdf": description}
    if smooth:
        case["pairs"] = []
        for index in range(PAIRS):
            # Most views are from the front; where there is nothing behind, that side is still tried.
            wo = direction(random, 0.05 if index % 4 else -1.0)
            wi = direction(random, -0.2 if index % 3 else -1.0)
            if index % 2:
                sample, weight = model.sample(
                    context, point(wo), random.uniform(), mi.Point2f(random.uniform(), random.uniform())
                )
                if max(weight) > 0.0:
                    wi = shortest(sample.wo)
            value, pdf = model.eval_pdf(context, point(wo), mi.Vector3f(wi))
            case["pairs"].append(shortest(wo) + shortest(wi) + shortest(value) + shortest([pdf]))
    if delta:
        case["delta"] = []
        for index in range(DELTA_DIRECTIONS):
            wo = direction(random, 0.05 if index % 2 else -1.0)
            for lobe in (0.0, 0.9990234375):
                sample, weight = model.sample(context, point(wo), lobe, mi.Point2f(0.3, 0.6))
                is_null = mi.has_flag(sample.sampled_type, mi.BSDFFlags.Null)
                is_delta = is_null or mi.has_flag(sample.sampled_type, mi.BSDFFlags.Delta)
                if not is_delta:
                    continue
                numbers = shortest([*sample.wo, *weight, sample.pdf, sample.eta])
                case["delta"].append([*wo, lobe, *numbers, int(is_null)])
    case["null"] = []
    for _ in range(NULL_DIRECTIONS):
        wo = direction(random)
        case["null"].append(wo + shortest(model.eval_null_transmission(point(wo))))
    return case


def conductor_presets() -> dict[str, list[float]]:
    """eta and k of every preset, per linear sRGB channel."""
    folder = pathlib.Path(mi.__file__).parent / "data" / "ior"
    presets = {}
    for path in sorted(folder.glob("*.eta.spd")):
        name = path.name.removesuffix(".eta.spd")
        parameters = mi.traverse(mi.load_dict({"type": "conductor", "material": name}))
        presets[name] = shortest([*parameters["eta.value"], *parameters["k.value"]])
    return presets


def main() -> None:
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for picture, content in PICTURES.items():
            (folder / picture).write_bytes(content)
        cases = [measure(key, description, folder) for key, description in CASES.items()]
    table = {
        "mitsuba": mi.__version__,
        "dp_du": DP_DU,
        "dp_dv": DP_DV,
        "uv": UV,
        "files": {picture: base64.b64encode(content).decode() for picture, content in PICTURES.items()},
        "conductors": conductor_presets(),
        "cases": cases,
    }
    # One row a line: readable differences when it is made anew.
    text = json.dumps(table, separators=(",", ":"))
    OUTPUT.write_text(text.replace("],[", "],\n[").replace('},{"name"', '},\n{"name"') + "\n")


if __name__ == "__main__":
    main()
