"""The key agreement of a connection: Noise_IK_25519_AESGCM_SHA256 of the Noise Protocol Framework, revision 34.

The initiator knows the responder's static key beforehand; its own travels encrypted:

    <- s
    ...
    -> e, es, s, ss
    <- e, ee, se

Names are those of the specification (noiseprotocol.org/noise.html, sections 5 and 7.5). The primitives come from the
``cryptography`` library: X25519 (RFC 7748), AES-256-GCM (NIST SP 800-38D), SHA-256, HKDF (RFC 5869). No input or
output here: bytes in, bytes out.
"""

from __future__ import annotations

import struct
from hashlib import sha256

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from pipeline.errors import ProtocolError

NAME = b"Noise_IK_25519_AESGCM_SHA256"
KEY_BYTES = 32
TAG_BYTES = 16
#: e, the encrypted s, and the tag of an empty payload
FIRST_BYTES = KEY_BYTES + KEY_BYTES + TAG_BYTES + TAG_BYTES
#: e, and the tag of an empty payload
SECOND_BYTES = KEY_BYTES + TAG_BYTES
_MAX_NONCE = 2**64 - 1
_NONCE = struct.Struct(">IQ")


class CipherState:
    """A key, and the number of the next message under it. One direction of one connection; not locked."""

    __slots__ = ("_aead", "_key", "_nonce")

    def __init__(self, key: bytes) -> None:
        self._key, self._aead, self._nonce = key, AESGCM(key), 0

    def encrypt(self, plaintext: bytes, ad: bytes = b"") -> bytes:
        """The next message, 16 bytes longer than the plaintext. ad: authenticated too, and not sent."""
        sealed = self._aead.encrypt(_NONCE.pack(0, self._nonce), plaintext, ad)
        self._nonce += 1
        return sealed

    def encrypt_into(self, plaintext: bytes, buffer: memoryview) -> None:
        """As encrypt, into a buffer of that length: a message is copied no oftener than it must be."""
        self._aead.encrypt_into(_NONCE.pack(0, self._nonce), plaintext, None, buffer)
        self._nonce += 1

    def decrypt(self, ciphertext: bytes | memoryview, ad: bytes | None = None) -> bytes:
        """The plaintext. Raises ProtocolError if it is not the next message of whoever has the key: one that was
        changed, left out, sent twice or out of its turn. The number stays as it was then.
        """
        try:
            plaintext = self._aead.decrypt(_NONCE.pack(0, self._nonce), ciphertext, ad)
        except (InvalidTag, ValueError):
            raise ProtocolError(
                "bytes that the other end of a link did not send, or not now", "not_authentic"
            ) from None
        self._nonce += 1
        return plaintext

    def rekey(self) -> None:
        """Go over to the next key; the one before cannot be found from it. Both ends at the same message."""
        self._key = self._aead.encrypt(_NONCE.pack(0, _MAX_NONCE), bytes(KEY_BYTES), b"")[:KEY_BYTES]
        self._aead = AESGCM(self._key)


class _Handshake:
    """The SymmetricState, and what both ends do with it."""

    def __init__(self, prologue: bytes, own: X25519PrivateKey, ephemeral: X25519PrivateKey | None) -> None:
        self.hash = NAME.ljust(KEY_BYTES, b"\0")
        self._chaining_key = self.hash
        self._cipher: CipherState | None = None
        self._own = own
        self._ephemeral = ephemeral or X25519PrivateKey.generate()
        self._mix_hash(prologue)

    def _mix_hash(self, data: bytes) -> None:
        self.hash = sha256(self.hash + data).digest()

    def _mix_key(self, private: X25519PrivateKey, public: bytes) -> None:
        try:
            shared = private.exchange(X25519PublicKey.from_public_bytes(public))
        except ValueError:  # of a point of low order: the result would be known to all
            raise ProtocolError("a key of the other end of a link that is none", "not_authentic") from None
        self._chaining_key, key = self._two_keys(shared)
        self._cipher = CipherState(key)

    def _two_keys(self, material: bytes) -> tuple[bytes, bytes]:
        both = HKDF(SHA256(), 2 * KEY_BYTES, self._chaining_key, b"").derive(material)
        return both[:KEY_BYTES], both[KEY_BYTES:]

    def _encrypt_and_hash(self, plaintext: bytes) -> bytes:
        assert self._cipher is not None
        sealed = self._cipher.encrypt(plaintext, self.hash)
        self._mix_hash(sealed)
        return sealed

    def _decrypt_and_hash(self, sealed: bytes) -> bytes:
        assert self._cipher is not None
        plaintext = self._cipher.decrypt(sealed, self.hash)
        self._mix_hash(sealed)
        return plaintext

    def _split(self) -> tuple[CipherState, CipherState]:
        first, second = self._two_keys(b"")
        return CipherState(first), CipherState(second)

    def _say_ephemeral(self) -> bytes:
        public = self._ephemeral.public_key().public_bytes_raw()
        self._mix_hash(public)
        return public


class Initiator(_Handshake):
    """Whoever connects. remote: the responder's static key, 32 bytes. ephemeral: given by tests alone."""

    def __init__(
        self,
        prologue: bytes,
        own: X25519PrivateKey,
        remote: bytes,
        ephemeral: X25519PrivateKey | None = None,
    ) -> None:
        super().__init__(prologue, own, ephemeral)
        self._remote = remote
        self._mix_hash(remote)

    def first(self, payload: bytes = b"") -> bytes:
        """The message that begins: FIRST_BYTES, and the payload. Raises ProtocolError if remote is no key."""
        ephemeral = self._say_ephemeral()
        self._mix_key(self._ephemeral, self._remote)
        static = self._encrypt_and_hash(self._own.public_key().public_bytes_raw())
        self._mix_key(self._own, self._remote)
        return ephemeral + static + self._encrypt_and_hash(payload)

    def second(self, message: bytes) -> tuple[bytes, CipherState, CipherState]:
        """The payload of the answer, and the ciphers to send and to receive with. Raises ProtocolError."""
        ephemeral = message[:KEY_BYTES]
        self._mix_hash(ephemeral)
        self._mix_key(self._ephemeral, ephemeral)
        self._mix_key(self._own, ephemeral)
        payload = self._decrypt_and_hash(message[KEY_BYTES:])
        return payload, *self._split()


class Responder(_Handshake):
    """Whoever is connected to. remote: the initiator's static key, once the first message was read."""

    def __init__(
        self, prologue: bytes, own: X25519PrivateKey, ephemeral: X25519PrivateKey | None = None
    ) -> None:
        super().__init__(prologue, own, ephemeral)
        self.remote = b""
        self._mix_hash(own.public_key().public_bytes_raw())

    def first(self, message: bytes) -> bytes:
        """Read the message that begins; its payload. Raises ProtocolError, also if it was meant for another."""
        self._remote_ephemeral = message[:KEY_BYTES]
        self._mix_hash(self._remote_ephemeral)
        self._mix_key(self._own, self._remote_ephemeral)
        static_end = KEY_BYTES + KEY_BYTES + TAG_BYTES
        self.remote = self._decrypt_and_hash(message[KEY_BYTES:static_end])
        self._mix_key(self._own, self.remote)
        return self._decrypt_and_hash(message[static_end:])

    def second(self, payload: bytes = b"") -> tuple[bytes, CipherState, CipherState]:
        """The answer, SECOND_BYTES and the payload, and the ciphers to send and to receive with."""
        ephemeral = self._say_ephemeral()
        self._mix_key(self._ephemeral, self._remote_ephemeral)
        self._mix_key(self._ephemeral, self.remote)
        message = ephemeral + self._encrypt_and_hash(payload)
        of_initiator, of_responder = self._split()
        return message, of_responder, of_initiator
