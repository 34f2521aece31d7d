"""Who an actor is: a key pair of its own, made where it runs. Only the public half ever leaves the process."""

from __future__ import annotations

from dataclasses import dataclass

from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey

from pipeline.link.noise import KEY_BYTES


class KeyPair:
    """An X25519 key pair (RFC 7748). It can be neither printed nor pickled, so that it stays where it was made."""

    __slots__ = ("private", "public")

    def __init__(self) -> None:
        self.private = X25519PrivateKey.generate()
        self.public = self.private.public_key().public_bytes_raw()

    def __repr__(self) -> str:
        return f"KeyPair({fingerprint(self.public)})"

    def __reduce__(self) -> str:
        raise TypeError("a key pair does not leave its process")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Where an actor listens, and which key it has to show there. key: public, 32 bytes."""

    host: str
    port: int
    key: bytes

    def __post_init__(self) -> None:
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"a public key of {len(self.key)} bytes; expected {KEY_BYTES}")

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return self.host, self.port


def fingerprint(public: bytes) -> str:
    """The first bytes of a public key, for logs: enough to tell the keys of one run apart."""
    return public[:6].hex()
