"""The Dockerfile and the scripts beside it, by linters; `test_image_steps.py` runs the Dockerfile's steps."""

from __future__ import annotations

import re

from tests.deploy.examples import DEPLOY, image_instructions, run, tool

# DL3008 wants versions of Debian packages: Debian keeps only the newest, with its security fixes.
NOT_CHECKED = ("--ignore", "DL3008")


def test_dockerfile_is_clean() -> None:
    checked = run(tool("hadolint"), *NOT_CHECKED, str(DEPLOY / "Dockerfile"))
    assert (checked.returncode, checked.stdout) == (0, "")


def test_scripts_are_clean() -> None:
    scripts = [*DEPLOY.glob("*.sh"), *DEPLOY.glob("slurm/*")]
    checked = run(tool("shellcheck"), "--severity=warning", *map(str, sorted(scripts)))
    assert (checked.returncode, checked.stdout) == (0, "")


def test_images_run_as_nobody_in_particular() -> None:
    for target in ("server", "tools"):
        users = [value for word, value in image_instructions(target) if word == "USER"]
        assert users[-1] == "10001"


def test_copied_files_are_there() -> None:
    for target in ("build", "python", "server", "tools"):
        for word, value in image_instructions(target):
            if word == "COPY" and "--from" not in value:
                for source in value.split()[:-1]:
                    assert (DEPLOY.parent / source).exists(), source
    stages = re.findall(r"^FROM \S+ AS (\w+)$", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE)
    assert stages == ["build", "python", "server", "tools"]
