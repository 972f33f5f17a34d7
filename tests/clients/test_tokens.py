"""Tokens and certificates by the command, without a server; and what a client does with them."""

from __future__ import annotations

import json
import stat
import time
from pathlib import Path

import fogbank
import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from fogbank.certificates import issue_server, make_authority
from fogbank.tokens import TokenFile
from fogbank_cli.exit_codes import ExitCode
from fogbank_cli.main import run


def printed(capsys: pytest.CaptureFixture[str], data: Path, *arguments: str) -> list[dict[str, object]]:
    """Events of a command that succeeds."""
    assert run(["--data", str(data), *arguments, "--json"]) == ExitCode.OK
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_create_list_revoke(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = printed(capsys, tmp_path, "token", "create", "--tenant", "studio", "--scope", "render", "--expires", "2h")[0]
    text = str(made["token"])
    assert text.startswith(f"fogbank_{made['id']}_")
    secret = text.rpartition("_")[2]
    assert len(text.split("_", 2)[2]) >= 43  # 256 bits
    assert secret not in (tmp_path / "tokens.json").read_text()
    other = printed(capsys, tmp_path, "token", "create", "--tenant", "other")[0]
    assert other["scopes"] == ["render", "upload"]
    listed = printed(capsys, tmp_path, "token", "ls")
    assert [item["id"] for item in listed] == [made["id"], other["id"]]
    assert [item["state"] for item in listed] == ["valid", "valid"]
    expires = listed[0]["expires"]
    assert isinstance(expires, int)
    assert 7100 < expires - time.time() <= 7200
    assert all("token" not in item and "sha256" not in item for item in listed)
    printed(capsys, tmp_path, "token", "revoke", str(made["id"]))
    printed(capsys, tmp_path, "token", "revoke", str(made["id"]))
    assert [item["state"] for item in printed(capsys, tmp_path, "token", "ls")] == ["revoked", "valid"]
    assert run(["--data", str(tmp_path), "token", "ls"]) == ExitCode.OK
    table = capsys.readouterr().out
    assert "revoked" in table
    assert secret not in table


@pytest.mark.parametrize(
    "arguments",
    [
        ("create",),
        ("create", "--tenant", "Studio"),
        ("create", "--tenant", "../up"),
        ("create", "--tenant", "a", "--scope", "all"),
        ("create", "--tenant", "a", "--expires", "soon"),
        ("create", "--tenant", "a", "--expires", "0d"),
        ("revoke", "unknown"),
    ],
)
def test_bad_requests_change_nothing(tmp_path: Path, arguments: tuple[str, ...]) -> None:
    assert run(["--data", str(tmp_path), "token", *arguments]) not in (ExitCode.OK, ExitCode.INTERNAL)
    assert TokenFile(tmp_path).read() == []


def test_a_server_must_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FOGBANK_DATA", raising=False)
    assert run(["token", "ls"]) == ExitCode.USAGE


def test_tls_init_makes_what_a_server_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "pki"
    printed(capsys, tmp_path, "tls", "init", str(folder), "--host", "render.example.org", "--host", "10.0.0.7")
    printed(capsys, tmp_path, "tls", "worker", str(folder), "farm")
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    server = x509.load_pem_x509_certificate((folder / "server.pem").read_bytes())
    server.verify_directly_issued_by(authority)
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["render.example.org"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["10.0.0.7"]
    for key in ("ca", "server", "farm"):
        assert stat.S_IMODE((folder / f"{key}.key").stat().st_mode) == 0o600
    before = (folder / "ca.pem").read_bytes(), (folder / "server.pem").read_bytes()
    # Clients rely on an authority that is there.
    assert run(["tls", "init", str(folder), "--host", "render.example.org"]) == ExitCode.LOCAL_FILE
    assert (folder / "ca.pem").read_bytes() == before[0]
    printed(capsys, tmp_path, "tls", "renew", str(folder), "--host", "render.example.org")
    assert (folder / "server.pem").read_bytes() != before[1]
    for taken in ("ca", "server", "Farm"):
        assert run(["tls", "worker", str(folder), taken]) == ExitCode.USAGE


def test_farms_have_an_authority_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    farm, server = tmp_path / "farm", tmp_path / "server"
    printed(capsys, tmp_path, "tls", "farm", str(farm))
    before = (farm / "ca.pem").read_bytes(), (farm / "dask.pem").read_bytes()
    printed(capsys, tmp_path, "tls", "farm", str(farm))
    assert (farm / "ca.pem").read_bytes() == before[0]
    assert (farm / "dask.pem").read_bytes() != before[1]
    certificate = x509.load_pem_x509_certificate((farm / "dask.pem").read_bytes())
    certificate.verify_directly_issued_by(x509.load_pem_x509_certificate(before[0]))
    usages = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert set(usages) == {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    assert stat.S_IMODE((farm / "dask.key").stat().st_mode) == 0o600
    # A tenant's certificate would open the farm.
    assert run(["tls", "worker", str(farm), "studio"]) == ExitCode.USAGE
    printed(capsys, tmp_path, "tls", "init", str(server), "--host", "localhost")
    assert run(["tls", "farm", str(server)]) == ExitCode.USAGE


def test_a_token_is_not_sent_where_others_can_read_it() -> None:
    with pytest.raises(fogbank.InvalidArgumentError, match="for everybody to read"):
        fogbank.connect("render.example.org:7070", credentials=fogbank.Credentials(token="fogbank_a_b"))
    assert "fogbank_a_b" not in repr(fogbank.Credentials(token="fogbank_a_b"))
    with pytest.raises(fogbank.InvalidArgumentError, match="belong together"):
        fogbank.connect("localhost:1", credentials=fogbank.Credentials(certificate=Path("a")))


def test_credentials_come_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_authority(tmp_path)
    issue_server(tmp_path, ["localhost"])
    monkeypatch.setenv("FOGBANK_TOKEN", "fogbank_a_b")
    monkeypatch.setenv("FOGBANK_CA", str(tmp_path / "ca.pem"))
    found = fogbank.Credentials.from_environment()
    assert found == fogbank.Credentials(token="fogbank_a_b", ca=tmp_path / "ca.pem")
    assert found.encrypted
    for name in ("TOKEN", "CA"):
        monkeypatch.delenv(f"FOGBANK_{name}")
    assert fogbank.Credentials.from_environment() == fogbank.Credentials()
