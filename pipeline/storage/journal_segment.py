"""One file of a journal: a first line, a header, then records, each with a checksum over all that came before it.

First line: ``searchlight journal VERSION``. Then records: length of the payload (4 bytes, little-endian), digest (16
bytes), payload. A digest is BLAKE2b over the digest before it, the length and the payload: a record that is torn or
flipped does not fit, nor does one that is whole but stands in another place. The first record is the header (msgpack):
kind, fingerprint, segment, after (the digest that the segment before it ended with).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack

from pipeline.errors import InputError
from pipeline.storage.disk import Disk

VERSION = 1
#: a record larger than this is none of ours, whatever its length field says
MOST_RECORD_BYTES = 64 * 1024 * 1024
_MAGIC = b"searchlight journal "
FIRST_LINE = _MAGIC + f"{VERSION}\n".encode("ascii")
_LENGTH_BYTES, _DIGEST_BYTES = 4, 16
#: what stands before each record
OVERHEAD_BYTES = _LENGTH_BYTES + _DIGEST_BYTES
#: the digest before the first one
GENESIS = bytes(_DIGEST_BYTES)


@dataclass(frozen=True)
class Identity:
    """Whose journal it is. kind: of its records. fingerprint: of the mission, its input and the code."""

    kind: str
    fingerprint: str


@dataclass(frozen=True)
class Segment:
    """What could be read of a file. digest: of the last good record. end: bytes up to there. fault: why no further.

    number: 0 if not even the header is good.
    """

    number: int
    after: bytes
    records: tuple[bytes, ...]
    digest: bytes
    end: int
    size: int
    fault: str | None


def framed(record: bytes, digest: bytes) -> tuple[bytes, bytes]:
    """The bytes of a record that follows one with this digest, and its own digest."""
    if len(record) > MOST_RECORD_BYTES:
        raise ValueError(f"a record of {len(record)} bytes; at most {MOST_RECORD_BYTES} are kept")
    length = len(record).to_bytes(_LENGTH_BYTES, "little")
    own = hashlib.blake2b(digest + length + record, digest_size=_DIGEST_BYTES).digest()
    return length + own + record, own


def head(identity: Identity, number: int, after: bytes) -> tuple[bytes, bytes]:
    """The bytes that a segment begins with, and the digest that its first record follows."""
    fields = {
        "kind": identity.kind,
        "fingerprint": identity.fingerprint,
        "segment": number,
        "after": after,
    }
    data, digest = framed(msgpack.packb(fields), GENESIS)
    return FIRST_LINE + data, digest


def read_segment(disk: Disk, path: Path, identity: Identity) -> Segment:
    """All good records from the beginning of a segment.

    Raises InputError for a file that is no journal, or one of another version, kind or mission.
    """
    with disk.open(path) as file:
        data = file.read()
    line = data[: len(FIRST_LINE)]
    if line != FIRST_LINE:
        _require_torn(path, line, data)
        return Segment(0, GENESIS, (), GENESIS, 0, len(data), "a header that is torn or damaged")
    payloads, digest, end, fault = _records(data, len(FIRST_LINE))
    fields = _header(payloads[0]) if payloads else None
    if fields is None:
        return Segment(0, GENESIS, (), GENESIS, 0, len(data), "a header that is torn or damaged")
    _require_ours(path, fields, identity)
    return Segment(fields["segment"], fields["after"], tuple(payloads[1:]), digest, end, len(data), fault)


def _records(data: bytes, at: int) -> tuple[list[bytes], bytes, int, str | None]:
    """Payloads, digest of the last, where it ends, and why the next one is not good."""
    payloads: list[bytes] = []
    digest = GENESIS
    while at < len(data):
        start = at + OVERHEAD_BYTES
        length = int.from_bytes(data[at : at + _LENGTH_BYTES], "little")
        if start > len(data) or length > MOST_RECORD_BYTES or start + length > len(data):
            return payloads, digest, at, "a record that is torn"
        payload = data[start : start + length]
        whole, own = framed(payload, digest)
        if whole[:OVERHEAD_BYTES] != data[at:start]:
            return payloads, digest, at, "a record whose checksum does not fit"
        payloads.append(payload)
        digest, at = own, start + length
    return payloads, digest, at, None


def _header(payload: bytes) -> dict[str, Any] | None:
    fields = msgpack.unpackb(payload)
    return fields if isinstance(fields, dict) and {"segment", "after"} <= fields.keys() else None


def _require_torn(path: Path, line: bytes, data: bytes) -> None:
    """Raises InputError unless a first line that is not ours may be ours, torn or damaged by a crash."""
    if _records(data, len(FIRST_LINE))[0]:
        return  # what follows is ours: a bit of the line has flipped
    version, end, _ = data[len(_MAGIC) : len(_MAGIC) + 8].partition(b"\n")
    if line.startswith(_MAGIC) and end and version.isdigit():
        expected = f"version {VERSION}, that of this Searchlight"
        raise InputError(path, f"a journal of version {version.decode()}", expected)
    alike = sum(a == b for a, b in zip(line, FIRST_LINE, strict=False))
    # blocks that were never written read as zeros
    if line.strip(b"\0") and alike < len(line) // 2:
        raise InputError(path, "a file that is no journal", "a journal of searchlight run")


def _require_ours(path: Path, fields: dict[str, Any], identity: Identity) -> None:
    if fields["kind"] != identity.kind:
        raise InputError(path, f"a journal of {fields['kind']}", identity.kind)
    if fields["fingerprint"] != identity.fingerprint:
        raise InputError(
            path,
            "the journal of another mission, of other input files, or of another version",
            "the mission, files and Searchlight that wrote it",
        )
