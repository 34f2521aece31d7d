"""Certificates for Ray's connections: whom they are for, who may read them, and what is said where they are not."""

from __future__ import annotations

import os
import shutil
import subprocess
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec

from actors.cluster import use_tls
from pipeline.errors import InputError

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl")


def certificates(folder: Path, *addresses: str) -> None:
    command = ["deployments/certificates.sh", str(folder), *addresses]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)


def node(tls: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"SEARCHLIGHT_SITES": "ground", "SEARCHLIGHT_TLS": tls}
    command = ["deployments/ray-node.sh", "--head"]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def test_each_machine_has_one_of_its_own_that_its_authority_has_signed(tmp_path: Path) -> None:
    certificates(tmp_path, "10.0.0.1", "10.0.0.11")
    for address in ("10.0.0.1", "10.0.0.11"):
        own = tmp_path / address
        checked = ["openssl", "verify", "-CAfile", own / "ca.crt", "-verify_ip", address, own / "node.crt"]
        subprocess.run(checked, check=True, capture_output=True)
        assert (own / "node.key").stat().st_mode & 0o077 == 0
    assert (tmp_path / "ca/ca.key").stat().st_mode & 0o077 == 0
    first = (tmp_path / "10.0.0.1/node.key").read_bytes()
    certificates(tmp_path, "10.0.0.1", "10.0.0.12")
    assert (tmp_path / "10.0.0.1/node.key").read_bytes() == first, "what is there stays"
    assert (tmp_path / "10.0.0.12/ca.crt").read_bytes() == (tmp_path / "10.0.0.1/ca.crt").read_bytes()


def test_a_node_without_certificates_or_with_old_ones_does_not_start(tmp_path: Path) -> None:
    refused = node(str(tmp_path / "none"))
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "none/ca.crt: found nothing; expected what deployments/certificates.sh makes" in refused.stderr
    certificates(tmp_path / "old", "10.0.0.1")
    (tmp_path / "old/10.0.0.1/node.crt").write_bytes(_expired())
    refused = node(str(tmp_path / "old/10.0.0.1"))
    assert refused.returncode == 2
    assert "found a certificate that has expired" in refused.stderr


def _expired() -> bytes:
    key, name = ec.generate_private_key(ec.SECP256R1()), x509.Name([])
    begin = datetime(2020, 1, 1, tzinfo=UTC)
    builder = x509.CertificateBuilder(name, name, key.public_key(), 1, begin, begin + timedelta(days=90))
    return builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)


@pytest.mark.parametrize("days", ["0", "-1", "a year"])
def test_days_that_are_none_are_refused(tmp_path: Path, days: str) -> None:
    command = ["deployments/certificates.sh", str(tmp_path), "10.0.0.1"]
    environment = os.environ | {"SEARCHLIGHT_TLS_DAYS": days}
    refused = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert refused.returncode == 2
    assert f"SEARCHLIGHT_TLS_DAYS: found {days}; expected" in refused.stderr


def test_the_command_uses_the_certificates_of_its_node_and_says_if_they_are_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("RAY_USE_TLS", "RAY_TLS_CA_CERT", "RAY_TLS_SERVER_CERT", "RAY_TLS_SERVER_KEY")
    for name in names:
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    monkeypatch.setenv("SEARCHLIGHT_TLS", "off")
    use_tls()
    assert "RAY_USE_TLS" not in os.environ
    monkeypatch.setenv("SEARCHLIGHT_TLS", str(tmp_path / "none"))
    with pytest.raises(InputError, match=r"no .*none/ca\.crt; expected what deployments/certificates"):
        use_tls()
    certificates(tmp_path, "10.0.0.1")
    monkeypatch.setenv("SEARCHLIGHT_TLS", str(tmp_path / "10.0.0.1"))
    use_tls()
    assert os.environ["RAY_USE_TLS"] == "1"
    assert os.environ["RAY_TLS_SERVER_KEY"] == str(tmp_path / "10.0.0.1/node.key")
