"""What the farm's tests render: small, with everything that travels."""

from __future__ import annotations

from pathlib import Path

import fogbank
import numpy as np
from fogbank import RenderOptions

# Isotropic fog, so that there are records; a mesh file, so that there is more than the XML to send.
_SCENE = """<scene version="3.0.0">
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective">
    <float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <sampler type="independent"><integer name="sample_count" value="4"/></sampler>
    <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/></film>
    <ref id="fog"/>
  </sensor>
  <medium type="homogeneous" id="fog">
    <rgb name="sigma_t" value="0.2, 0.25, 0.3"/><rgb name="albedo" value="0.8, 0.8, 0.7"/>
  </medium>
  <shape type="cube">
    <transform name="to_world"><scale value="6"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/>
  </shape>
  <shape type="rectangle">
    <transform name="to_world"><rotate x="1" angle="90"/><translate y="2"/></transform>
    <emitter type="area"><rgb name="radiance" value="8, 7, 6"/></emitter>
  </shape>
  <shape type="obj">
    <string name="filename" value="wedge.obj"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf>
  </shape>
</scene>
"""
_WEDGE = "v -1 -1 0\nv 1 -1 0\nv 0 0.5 -0.5\nv 0 -1 1\nf 1 2 3\nf 2 4 3\nf 4 1 3\n"


def write_scene(folder: Path) -> Path:
    """Writes the scene's files; the path of its XML."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "wedge.obj").write_text(_WEDGE)
    path = folder / "fog.xml"
    path.write_text(_SCENE)
    return path


# Many small tiles, several passes, every channel.
PATHS = RenderOptions(integrator="volpath", size=(160, 96), spp=8, tile_size=16, pixel_type="float", variance=True)
RECORDS = RenderOptions(
    integrator="radiance-cache", size=(64, 40), spp=4, tile_size=16, pixel_type="float", variance=True, aovs=["bias"]
)
BEAMS = RenderOptions(integrator="photon-beams", size=(64, 40), spp=3, tile_size=16, pixel_type="float")

# 200 tiles.
TILES = RenderOptions(**{**PATHS, "size": (320, 160), "spp": 12})


def assert_same_pictures(one: fogbank.Image, other: fogbank.Image) -> None:
    """Every channel the same, bit for bit."""
    np.testing.assert_array_equal(np.asarray(one), np.asarray(other))
    if one.variance is not None:
        assert other.variance is not None
        np.testing.assert_array_equal(one.variance, other.variance)
    assert one.aovs.keys() == other.aovs.keys()
    for name, values in one.aovs.items():
        np.testing.assert_array_equal(values, other.aovs[name])
    assert one.metadata["fogbank:samples"] == other.metadata["fogbank:samples"]
    assert np.all(np.isfinite(np.asarray(one)))
