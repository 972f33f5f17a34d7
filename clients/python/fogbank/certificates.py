"""An authority of one's own, and the certificates that it signs: for servers, and for workers instead of a token."""

from __future__ import annotations

import datetime
import errno
import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from fogbank.errors import InvalidArgumentError

AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 397
_CLOCK_SKEW = datetime.timedelta(hours=1)


@dataclass(frozen=True)
class CertificateFiles:
    """A certificate and its private key, in PEM format; only the user can read the key."""

    certificate: Path
    key: Path


def make_authority(folder: Path) -> CertificateFiles:
    """Makes ca.pem and ca.key; FileExistsError where there is one, which servers and clients may rely on."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Fogbank authority")])
    builder = (
        _builder(name, name, key.public_key(), AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
    )
    return _write(folder, "ca", builder.sign(key, hashes.SHA256()), key)


def issue_server(folder: Path, hosts: Sequence[str]) -> CertificateFiles:
    """Makes server.pem and server.key, signed by the authority in `folder`, for these host names and addresses.

    Replaces what is there: running servers take the new one within seconds.
    """
    if not hosts:
        raise InvalidArgumentError("a server's certificate needs the names that clients know it by")
    alternatives = x509.SubjectAlternativeName([_general_name(host) for host in hosts])
    return _issue(folder, "server", hosts[0], [ExtendedKeyUsageOID.SERVER_AUTH], alternatives, replace=True)


def issue_client(folder: Path, tenant: str) -> CertificateFiles:
    """Makes {tenant}.pem and {tenant}.key: whoever has them may render and upload as this tenant, without a token."""
    return _issue(folder, tenant, tenant, [ExtendedKeyUsageOID.CLIENT_AUTH], None, replace=False)


def issue_farm(folder: Path) -> CertificateFiles:
    """Makes dask.pem and dask.key, or replaces them: for Dask's scheduler, workers and clients, each of which calls and
    is called. Whoever has them may run programs on every worker.
    """
    both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    return _issue(folder, "dask", "Fogbank farm", both, None, replace=True)


def _issue(
    folder: Path,
    file_name: str,
    common_name: str,
    usages: Sequence[x509.ObjectIdentifier],
    alternatives: x509.SubjectAlternativeName | None,
    *,
    replace: bool,
) -> CertificateFiles:
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    authority_key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), password=None)
    if not isinstance(authority_key, ec.EllipticCurvePrivateKey):
        raise InvalidArgumentError(f"{folder / 'ca.key'} is not a key that this command has made")
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name[:64])])
    builder = (
        _builder(name, authority.subject, key.public_key(), CERTIFICATE_DAYS)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
    )
    if alternatives is not None:
        builder = builder.add_extension(alternatives, critical=False)
    return _write(folder, file_name, builder.sign(authority_key, hashes.SHA256()), key, replace=replace)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCK_SKEW)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey, *, replace: bool = False
) -> CertificateFiles:
    folder.mkdir(parents=True, exist_ok=True)
    files = CertificateFiles(folder / f"{name}.pem", folder / f"{name}.key")
    if not replace and (files.certificate.exists() or files.key.exists()):
        raise FileExistsError(errno.EEXIST, "there already", str(files.certificate))
    key_text = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    # A server that looks in between finds a pair that does not match, and takes nobody until it looks again.
    _replace(files.key, key_text, 0o600)
    _replace(files.certificate, certificate.public_bytes(serialization.Encoding.PEM), 0o644)
    return files


def _replace(path: Path, data: bytes, mode: int) -> None:
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, mode)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
    temporary.replace(path)
