"""Quotas by the command, without a server; what a server makes of them is tested in tests/service/test_quotas.py."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fogbank.quotas import Quota, QuotaFile
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.main import run


def test_set_list_and_remove(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def command(*arguments: str) -> str:
        assert run(["--data", str(tmp_path), "quota", *arguments]) == ExitCode.OK
        return capsys.readouterr().out

    made = command("set", "studio", "--jobs", "20", "--stored", "50G", "--cpu", "7200", "--window", "2h")
    assert made == "studio: 20 jobs, 50 GB stored, 7200 CPU seconds in 2 h 00 min\n"
    command("set", "*", "--watchers", "0", "--cache", "500M")
    assert QuotaFile(tmp_path).read() == {
        "*": Quota(watchers=0, cache_bytes=500_000_000),
        "studio": Quota(jobs=20, stored_bytes=50 * 10**9, cpu_seconds=7200, window_seconds=7200),
    }
    lines = [json.loads(line) for line in command("ls", "--json").splitlines()]
    assert [line["tenant"] for line in lines] == ["*", "studio"]
    assert lines[0]["jobs"] is None
    # A second line replaces the first.
    command("set", "studio", "--jobs", "1")
    assert QuotaFile(tmp_path).read()["studio"] == Quota(jobs=1)
    command("rm", "studio")
    assert set(QuotaFile(tmp_path).read()) == {"*"}


@pytest.mark.parametrize(
    "arguments",
    [
        ("set", "No Name", "--jobs", "1"),
        ("set", "a", "--jobs", "-1"),
        ("set", "a", "--stored", "1.5G"),
        ("set", "a", "--cpu", "nan"),
        ("set", "a", "--window", "0h"),
        ("rm", "nobody"),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    assert run(["--data", str(tmp_path), "quota", *arguments]) not in (ExitCode.OK, ExitCode.INTERNAL)
    assert not (tmp_path / "quotas.json").exists()


@pytest.mark.parametrize("text", ["{", '{"version": 2}', '{"version": 1, "quotas": {"a": {"cpus": 1}}}'])
def test_a_file_of_somebody_else_is_left_alone(tmp_path: Path, text: str) -> None:
    (tmp_path / "quotas.json").write_text(text)
    assert run(["--data", str(tmp_path), "quota", "set", "a", "--jobs", "1"]) not in (ExitCode.OK, ExitCode.INTERNAL)
    assert (tmp_path / "quotas.json").read_text() == text
