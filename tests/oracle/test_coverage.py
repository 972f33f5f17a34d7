"""The oracle's tiny scenes cover what the loader supports, and their references are those of the pinned Mitsuba."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

from tests.oracle import references
from tests.oracle.cases import REPOSITORY, feature_cases, stored_cases

PLUGINS = {
    "bsdf": "diffuse twosided null dielectric thindielectric conductor roughconductor roughdielectric plastic "
    "roughplastic mask blendbsdf bumpmap normalmap principled",
    "emitter": "area point spot directional constant envmap",
    "shape": "obj ply serialized rectangle cube sphere disk cylinder shapegroup instance",
    "phase": "isotropic hg",
    "texture": "bitmap checkerboard scale",
    "sensor": "perspective thinlens orthographic",
    "medium": "homogeneous",
    "rfilter": "box tent gaussian",
}


def documents() -> list[ElementTree.ElementTree[ElementTree.Element]]:
    return [ElementTree.parse(case.scene) for case in feature_cases()]


def test_every_plugin_has_a_scene() -> None:
    used = {(element.tag, element.get("type")) for document in documents() for element in document.iter()}
    missing = [f"{tag} {name}" for tag, names in PLUGINS.items() for name in names.split() if (tag, name) not in used]
    assert not missing


def test_every_kind_of_light_shape_and_view_has_a_scene() -> None:
    area_lights, values, extinctions = set(), set(), []
    for document in documents():
        for shape in document.iter("shape"):
            if shape.find("emitter[@type='area']") is not None:
                area_lights.add(shape.get("type"))
        values |= {(element.get("name"), element.get("value")) for element in document.iter()}
        for medium in document.iter("medium"):
            sigma_t = medium.find("rgb[@name='sigma_t']")
            assert sigma_t is not None
            numbers = [float(number) for number in sigma_t.get("value", "").split(",")]
            extinctions.append(max(numbers) / min(numbers))
    assert {"rectangle", "sphere", "disk", "cylinder", "ply", "cube"} <= area_lights
    assert {("fov_axis", axis) for axis in ("x", "y", "diagonal", "smaller", "larger")} <= values
    assert {("g", g) for g in ("-0.5", "0", "0.3", "0.8")} <= values
    assert {("flip_normals", "true"), ("face_normals", "true"), ("raw", "true")} <= values
    assert max(extinctions) >= 20 * (1 - 1e-9)


def test_references_come_from_the_pinned_mitsuba() -> None:
    pins = re.findall(r'"mitsuba==([0-9.]+)"', (REPOSITORY / "pyproject.toml").read_text())
    assert len(pins) == 1
    for case in stored_cases():
        about = references.description(case.reference)
        assert about["mitsuba"] == pins[0], case.name
        # With fewer batches the reference's own variance would be the weak link of the comparison.
        assert about["batches"] >= 32, case.name
