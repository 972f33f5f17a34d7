"""Carries out stages of the Dockerfile in folders with a minimal Debian, and runs programs there as a container does.

Where Docker has layers this has one folder; where it has a network of its own, so has this. Needs root.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from tests.deploy.examples import REPOSITORY, image_instructions, run

PATIENCE_SECONDS = 1800.0
MACHINE_AUTHORITIES = Path("/etc/ssl/certs/ca-certificates.crt")
AUTHORITIES = "/authorities.pem"
"""The same inside, where packages that are installed leave it alone."""


def bootstrap(folder: Path) -> None:
    """A minimal Debian 12, from where this machine has its packages, with their security fixes."""
    listed = run("apt-get", "indextargets", "--format", "$(SITE)", "Created-By: Packages", "Codename: bookworm").stdout
    made = subprocess.run(
        ["debootstrap", "--variant=minbase", "bookworm", str(folder), *listed.split()[:1]],
        capture_output=True, text=True, timeout=PATIENCE_SECONDS, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout + made.stderr
    for name in ("/etc/apt/sources.list", "/etc/apt/sources.list.d/debian.sources", "/etc/resolv.conf"):
        if Path(name).is_file():
            shutil.copy(name, folder / name[1:])
    if MACHINE_AUTHORITIES.is_file():
        shutil.copy(MACHINE_AUTHORITIES, folder / AUTHORITIES[1:])


def _of_this_machine() -> dict[str, str]:
    """What this machine's pip and uv are told about registries, and whom it trusts."""
    told = {name: value for name, value in os.environ.items() if name.startswith(("PIP_", "UV_"))}
    return told | ({"SSL_CERT_FILE": AUTHORITIES, "PIP_CERT": AUTHORITIES} if MACHINE_AUTHORITIES.is_file() else {})


def copy_root(origin: Path, copy: Path) -> None:
    """Copies a whole system; its device nodes as such, and not what they would give when read."""
    subprocess.run(["cp", "--archive", "--one-file-system", str(origin), str(copy)], check=True)


@dataclass
class Image:
    """A stage that was carried out."""

    folder: Path
    user: str = "0"
    workdir: str = "/"
    environment: dict[str, str] = field(
        default_factory=lambda: {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
    )
    entrypoint: list[str] = field(default_factory=list)
    command: list[str] = field(default_factory=list)
    health: list[str] = field(default_factory=list)
    volumes: list[str] = field(default_factory=list)

    def build(self, target: str, stages: dict[str, Path], *, commands: bool = True) -> None:
        """Carries out a stage's instructions, or all but its commands; `stages` has the folders of COPY --from=."""
        for word, value in image_instructions(target):
            if word == "RUN" and not commands:
                continue
            if word == "RUN":
                self.run(value)
            elif word == "COPY":
                self._copy(shlex.split(value), stages)
            elif word == "USER":
                self.user = value
            elif word == "WORKDIR":
                self.workdir = value
                (self.folder / value[1:]).mkdir(parents=True, exist_ok=True)
            elif word == "ENV":
                name, _, text = value.partition("=")
                self.environment[name] = text.replace("$PATH", self.environment["PATH"])
            elif word == "ENTRYPOINT":
                self.entrypoint = json.loads(value)
            elif word == "CMD":
                self.command = json.loads(value)
            elif word == "VOLUME":
                self.volumes.append(value)
            elif word == "HEALTHCHECK":
                self.health = [] if value == "NONE" else json.loads(value[value.index("CMD ") + 4 :])
            else:
                assert word == "FROM", f"{word}: unknown"

    def run(self, command: str) -> None:
        """A command of the Dockerfile."""
        settings = [f"{name}={value}" for name, value in (_of_this_machine() | self.environment).items()]
        inside = ["chroot", str(self.folder), "env", "-i", "-C", self.workdir, "DEBIAN_FRONTEND=noninteractive"]
        done = subprocess.run(
            [*inside, *settings, "/bin/sh", "-c", command],
            capture_output=True, text=True, timeout=PATIENCE_SECONDS, check=False,
        )  # fmt: skip
        assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"

    def _copy(self, words: list[str], stages: dict[str, Path]) -> None:
        origin = stages[words.pop(0).partition("=")[2]] if words[0].startswith("--from=") else REPOSITORY
        *sources, target = words
        to = self.folder / (target if target.startswith("/") else f"{self.workdir}/{target}").lstrip("/")
        if target.endswith("/"):
            to.mkdir(parents=True, exist_ok=True)
        for source in sources:
            found = origin / source.lstrip("/")
            if found.is_dir():
                shutil.copytree(found, to, symlinks=True, dirs_exist_ok=True)
            else:
                shutil.copy(found, to / found.name if target.endswith("/") else to)

    def started(self, network: Network, command: list[str], data: Path) -> list[str]:
        """What runs a command as a container would: all but /tmp and the volume /data read-only, no rights."""
        settings = [f"{name}={value}" for name, value in self.environment.items()]
        # Its /proc shows the processes of its own namespace.
        script = f"""
            mount --make-rprivate /
            mount --bind {self.folder} {self.folder} && mount -o remount,bind,ro {self.folder}
            mount -t tmpfs tmpfs {self.folder}/tmp
            mount --bind {data} {self.folder}/data
            mount -t proc proc {self.folder}/proc
            cd {self.folder}
            exec chroot {self.folder} setpriv --reuid={self.user} --regid={self.user} --clear-groups \
                --no-new-privs --bounding-set=-all --inh-caps=-all \
                env -i -C {self.workdir} {shlex.join(settings)} {shlex.join(command)}
        """
        return [*network.inside, "unshare", "--mount", "--pid", "--fork", "--kill-child", "sh", "-ec", script]


@dataclass(frozen=True)
class Network:
    """A network namespace with nothing but loopback."""

    name: str

    @property
    def inside(self) -> list[str]:
        """What a command begins with that runs there."""
        return ["ip", "netns", "exec", self.name]

    def __enter__(self) -> Network:
        """Makes it."""
        subprocess.run(["ip", "netns", "add", self.name], check=True)
        subprocess.run([*self.inside, "ip", "link", "set", "lo", "up"], check=True)
        return self

    def __exit__(self, *unused: object) -> None:
        """Removes it."""
        subprocess.run(["ip", "netns", "del", self.name], check=True)
