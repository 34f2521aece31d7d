"""The key agreement is Noise's, to the byte, and gives keys to nobody but its two ends."""

from __future__ import annotations

import pickle

import pytest
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from pipeline.errors import ProtocolError
from pipeline.link.keys import KeyPair
from pipeline.link.noise import FIRST_BYTES, SECOND_BYTES, CipherState, Initiator, Responder

#: Noise_IK_25519_AESGCM_SHA256 of cacophony's published test vectors (vectors/cacophony.txt, public domain), as they
#: also stand in snow's; the same bytes come from the package noiseprotocol 0.3.1. (The hash that stands there is of
#: neither of these; we hand out none.)
PROLOGUE = "4a6f686e2047616c74"
INITIATOR = "e61ef9919cde45dd5f82166404bd08e38bceb5dfdfded0a34c8df7ed542214d1"
INITIATOR_ONCE = "893e28b9dc6ca8d611ab664754b8ceb7bac5117349a4439a6b0569da977c464a"
RESPONDER = "4a3acbfdb163dec651dfa3194dece676d437029c62a408b4c5ea9114246e4893"
RESPONDER_ONCE = "bbdb4cdbd309f1a1f2e1456967fe288cadd6f712d65dc7b7793d5e63da6b375b"
SAID = [
    (
        "4c756477696720766f6e204d69736573",
        "ca35def5ae56cec33dc2036731ab14896bc4c75dbb07a61f879f8e3afa4c79444e417bc55c7a8166c993356c1be41ef67818a292426f30"
        "1556c7f26b21d25ddb097153891a9a956cff47b83e63ad8d701c1342c209cff1ca5ecd43402762ac249e3bd3a4c0a145fe07cb5dae28ea"
        "13a3",
    ),
    (
        "4d757272617920526f746862617264",
        "95ebc60d2b1fa672c1f46a8aa265ef51bfe38e7ccb39ec5be34069f144808843af2ccf9972e22afc67aeafcd25162f7f98c363b7762e3e"
        "4cb7d272e39f27a5",
    ),
    ("462e20412e20486179656b", "66acfc92e3197de166809e6d4d5d003dcc819a84bc3522ca53c9d9"),
    ("4361726c204d656e676572", "71f89aa6533a6de70b0826864dd75f60806ee40170c16290189eb3"),
    (
        "4a65616e2d426170746973746520536179",
        "4795a3423550c8bf00386bd496a3e2c76c10669d2a75ab8f79b5094c5412a25705",
    ),
    (
        "457567656e2042f6686d20766f6e2042617765726b",
        "aa0bb39097555c918e40be82abc2b909eb79d9eb87adb07e268fc37323a6cf904fd01fb391",
    ),
]


def private(text: str) -> X25519PrivateKey:
    return X25519PrivateKey.from_private_bytes(bytes.fromhex(text))


def ends() -> tuple[Initiator, Responder]:
    prologue, responder = bytes.fromhex(PROLOGUE), private(RESPONDER)
    return (
        Initiator(
            prologue, private(INITIATOR), responder.public_key().public_bytes_raw(), private(INITIATOR_ONCE)
        ),
        Responder(prologue, responder, private(RESPONDER_ONCE)),
    )


def test_the_published_vector() -> None:
    initiator, responder = ends()
    plain, sealed = zip(*((bytes.fromhex(p), bytes.fromhex(s)) for p, s in SAID), strict=True)
    assert initiator.first(plain[0]) == sealed[0]
    assert responder.first(sealed[0]) == plain[0]
    assert responder.remote == private(INITIATOR).public_key().public_bytes_raw()
    answer, from_responder, to_responder = responder.second(plain[1])
    assert answer == sealed[1]
    payload, by_initiator, to_initiator = initiator.second(sealed[1])
    assert payload == plain[1]
    assert initiator.hash == responder.hash
    for index in (2, 4):
        assert by_initiator.encrypt(plain[index]) == sealed[index]
        assert to_responder.decrypt(sealed[index]) == plain[index]
        assert from_responder.encrypt(plain[index + 1]) == sealed[index + 1]
        assert to_initiator.decrypt(sealed[index + 1]) == plain[index + 1]


def test_the_lengths_are_those_that_the_handshake_reads() -> None:
    initiator, responder = ends()
    first = initiator.first()
    assert len(first) == FIRST_BYTES
    responder.first(first)
    assert len(responder.second()[0]) == SECOND_BYTES


@pytest.mark.parametrize("changed", range(0, FIRST_BYTES, 5))
def test_a_first_message_that_was_changed_is_of_nobody(changed: int) -> None:
    initiator, responder = ends()
    message = bytearray(initiator.first())
    message[changed] ^= 1
    with pytest.raises(ProtocolError) as refused:
        responder.first(bytes(message))
    assert refused.value.reason == "not_authentic"


@pytest.mark.parametrize("changed", range(0, SECOND_BYTES, 3))
def test_an_answer_that_was_changed_is_of_nobody(changed: int) -> None:
    initiator, responder = ends()
    responder.first(initiator.first())
    message = bytearray(responder.second()[0])
    message[changed] ^= 0x40
    with pytest.raises(ProtocolError):
        initiator.second(bytes(message))


def test_another_responder_cannot_read_what_was_meant_for_one() -> None:
    initiator, _ = ends()
    with pytest.raises(ProtocolError):
        Responder(bytes.fromhex(PROLOGUE), KeyPair().private).first(initiator.first())


@pytest.mark.parametrize("low", [bytes(32), b"\x01" + bytes(31), b"\xed" + b"\xff" * 30 + b"\x7f"])
def test_keys_that_give_a_secret_known_to_all_are_refused(low: bytes) -> None:
    with pytest.raises(ProtocolError):
        Initiator(b"", KeyPair().private, low).first()
    with pytest.raises(ProtocolError):
        Responder(b"", KeyPair().private).first(low + bytes(FIRST_BYTES - 32))


def test_the_next_key_is_noise_s() -> None:
    key = bytes(range(32))
    cipher = CipherState(key)
    cipher.rekey()
    expected = AESGCM(key).encrypt(bytes(4) + b"\xff" * 8, bytes(32), b"")[:32]
    assert cipher.encrypt(b"x") == AESGCM(expected).encrypt(bytes(12), b"x", b"")


def test_a_key_pair_is_neither_printed_nor_pickled() -> None:
    keys = KeyPair()
    secret = keys.private.private_bytes_raw()
    assert secret.hex() not in repr(keys)
    with pytest.raises(TypeError, match="does not leave"):
        pickle.dumps(keys)
