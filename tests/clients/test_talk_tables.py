"""`fogbank reproduce statues` and `staircase`: what their tables say, on numbers that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from fogbank.comparison import analysis
from fogbank.comparison.runs import Run
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.figures import talk, talk_tables
from fogbank_cli.main import run

CACHES = talk_tables.Caches(talk.AWARE, talk.SPHERES, talk.UNAWARE)


def picture(method: str, records: int, error: float) -> Run:
    """Of a comparison at equal records."""
    figures = {"records": records, "cpu_seconds": 1.0, "wall_seconds": 1.0}
    return Run(method, records, 1, status="done", figures=figures, errors={"trimmed": error})


def test_ellipsoids_save_records() -> None:
    """Error falls as 1 / records; spheres need twice as many: 50 % saved at every level that both reach."""
    runs = [picture(talk.AWARE, n, 10 / n) for n in (100, 1000)]
    runs += [picture(talk.SPHERES, n, 20 / n) for n in (100, 1000)]
    records, _ = talk_tables._ellipsoids(analysis.summary(analysis.table(runs)), CACHES)
    assert "| 50% (50% to 50%) | 30% |" in records
    none, _ = talk_tables._ellipsoids(analysis.summary(analysis.table(runs[:2])), CACHES)
    assert "no common error" in none


def test_bounds_where_one_never_gets_there() -> None:
    """The aware cache begins where the unaware one hasn't come with ten times the records; and the other way round."""
    runs = [picture(talk.AWARE, n, 1 / n) for n in (100, 1000)]
    runs += [picture(talk.UNAWARE, n, 10 / n) for n in (10, 100, 500)]
    records, _ = talk_tables._aware(analysis.summary(analysis.table(runs)), CACHES)
    # 0.01 is what 100 records of the one have, and more than what 500 of the other have.
    assert "| over 5x | - |" in records
    turned = talk_tables._ratios(analysis.summary(analysis.table(runs)), talk.AWARE, talk.UNAWARE, "records")
    assert (turned.exact, turned.at_least) == ([], None)
    assert turned.at_most == pytest.approx(0.2)


def test_caches_without_records_in_the_fog_are_noticed() -> None:
    """Equal errors are the same pictures."""
    same = [picture(name, 100, 0.1) for name in (talk.AWARE, talk.UNAWARE)]
    assert talk_tables._same(analysis.summary(analysis.table(same)), CACHES)
    assert not talk_tables._same(
        analysis.summary(analysis.table([same[0], replace(same[1], errors={"trimmed": 0.2})])), CACHES
    )
    assert not talk_tables._same(analysis.summary(analysis.table([])), CACHES)


def test_absent_scenes_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the name of what is missing, and how to go on."""
    (scene,) = talk.STATUES
    monkeypatch.setattr(talk, "STATUES", (replace(scene, path=tmp_path / "room_fog.xml"),))
    assert run(["reproduce", "statues", "-o", str(tmp_path / "out")]) == ExitCode.USAGE
    said = capsys.readouterr().err
    assert "NOT COMPARED: room_fog" in said
    assert "--scene" in said
