"""Which scenes the oracle compares, at which size and with how many samples."""

from __future__ import annotations

import hashlib
import os
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("FOGBANK_SHARED", REPOSITORY.parent / "shared"))
REFERENCES = Path(__file__).resolve().parent / "references"


@dataclass(frozen=True)
class Case:
    """A scene with the settings that both renderers get.

    Attributes:
        name: unique; also the reference's file name.
        scene: the XML file.
        root: folder that its files lie in.
        parameters: values for its <default>s.
        spp, batches: Fogbank renders `batches` times `spp` samples per pixel.
        reference_spp, reference_batches: likewise for Mitsuba.
        reference_integrator: Mitsuba's; volpathmis where volpath's weights for chromatic extinction would need
            unreasonably many samples. Both are unbiased.
        box_filter: false if neighbouring pixels share samples.
    """

    name: str
    scene: Path
    root: Path
    parameters: dict[str, str] = field(default_factory=dict)
    spp: int = 16
    batches: int = 16
    reference_spp: int = 128
    reference_batches: int = 32
    reference_integrator: str = "volpath"
    box_filter: bool = True

    @property
    def reference(self) -> Path:
        return REFERENCES / f"{self.name}.exr"

    @property
    def mitsuba_scene(self) -> Path:
        """NAME.mitsuba.xml beside the scene if there is one: the same scene in words that Mitsuba knows."""
        other = self.scene.with_suffix(".mitsuba.xml")
        return other if other.is_file() else self.scene

    @property
    def available(self) -> bool:
        return self.scene.is_file()


def feature_cases() -> list[Case]:
    """The tiny scenes of this folder: each BSDF, emitter, shape, phase function, texture, sensor, kind of medium."""
    folder = Path(__file__).resolve().parent / "scenes"
    cases = []
    for path in sorted(folder.glob("*.xml")):
        if path.name.endswith(".mitsuba.xml"):
            continue
        name = path.stem
        chromatic = name.startswith("medium_chromatic_20")
        cases.append(
            Case(
                name,
                path,
                folder,
                # Glossy and specular paths to a small light are rare and bright: more samples for a usable variance.
                spp=32 if name.startswith(("bsdf_", "medium_")) else 16,
                reference_integrator="volpathmis" if chromatic else "volpath",
                box_filter="rfilter_" not in name,
            )
        )
    return cases


def project_cases() -> list[Case]:
    """The scenes of scenes/, small."""
    small = {"width": "32", "height": "32"}
    cases = []
    for name in ("shafts", "penumbra", "glow", "stairs"):
        folder = REPOSITORY / "scenes" / name
        cases.append(Case(f"scenes_{name}", folder / f"{name}.xml", folder, small, reference_spp=64))
    return cases


def shared_cases() -> list[Case]:
    """Scenes by others, in the shared data: closed forms and four of Mitsuba's own render tests without grids."""
    analytic = SHARED / "data" / "analytic"
    media = SHARED / "data" / "mitsuba-tests" / "tests" / "scenes" / "participating_media"
    cases = [
        Case(f"shared_{name}", analytic / f"{name}.xml", analytic)
        for name in ("absorbing_slab", "furnace_medium_isotropic", "furnace_surface_box")
    ]
    for name in ("homo_area_light", "homo_null_envmap", "homo_obj_inside_medium", "surf_area_light"):
        # Their textures lie three folders up.
        root = media.parents[2]
        cases.append(Case(f"shared_{name}", media / f"test_{name}_volpath.xml", root, {"res": "32"}, spp=32))
    return cases


def stored_cases() -> list[Case]:
    """All cases whose references are committed in references/."""
    return feature_cases() + project_cases() + shared_cases()


def scene_digest(case: Case) -> str:
    """SHA-256 over the parameters, the XML, what it includes, and each file that it names, in order of their use."""
    digest = hashlib.sha256(repr(sorted(case.parameters.items())).encode())
    pending = [case.mitsuba_scene]
    seen: set[Path] = set()
    while pending:
        path = pending.pop(0)
        if path in seen:
            continue
        seen.add(path)
        digest.update(path.read_bytes())
        if path.suffix != ".xml":
            continue
        document = ElementTree.parse(path)
        folders = [case.mitsuba_scene.parent]
        folders += [case.mitsuba_scene.parent / element.get("value", "") for element in document.iter("path")]
        names = [element.get("filename", "") for element in document.iter("include")]
        names += [element.get("value", "") for element in document.iter("string") if element.get("name") == "filename"]
        for name in names:
            found = [folder / name for folder in folders if (folder / name).is_file()]
            if not found:
                raise FileNotFoundError(f"{path}: no file {name}")
            pending.append(found[0])
    return digest.hexdigest()
