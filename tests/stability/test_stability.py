"""A part of `make stability`: fewer parameters, one shape of each family."""

import dataclasses

import pytest

from tests.bench.engines import BINARIES
from tests.stability.cases import FAMILIES, Family
from tests.stability.measure import measure
from tests.stability.report import is_enough
from tests.stability.scenes import SCENE_FAMILIES, SceneFamily, is_as_allowed, measure_scenes

# What float must keep where it is said to be enough.
FLOAT_ERROR = 1e-2


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_closed_forms_are_finite_and_right_where_they_say_so(family: Family) -> None:
    assert (BINARIES / "stability_evaluate").exists(), "make build builds it"
    part = dataclasses.replace(family, parameters=family.parameters[::3])
    for row in measure([part], shapes=1):
        where = f"{row.family}, {row.parameter:g}, {row.precision}"
        assert row.is_finite, where
        if is_enough(family, row):
            assert not row.is_wrong_sign, where
            assert row.worst_error <= (FLOAT_ERROR if row.precision == "float" else family.double_error), where


@pytest.mark.parametrize("family", SCENE_FAMILIES, ids=lambda family: family.name)
def test_estimates_hold_in_stiff_scenes(family: SceneFamily) -> None:
    part = dataclasses.replace(family, parameters=family.parameters[::3])
    for row in measure_scenes([part]):
        assert is_as_allowed(family, row), f"{row.parameter:g}: {row.errors}"
