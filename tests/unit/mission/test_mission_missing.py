"""Of a stream that is encoded again only what is missing is sent, and it decodes to the same pixels."""

import numpy as np
import pytest

from pipeline.geo.pose import enu_from_camera
from pipeline.link.codec import Decoder, Encoder, available_codecs
from pipeline.messages import CameraPose, EndOfStream, Packet
from pipeline.mission.missing import WhatIsMissing

POSE = CameraPose(np.zeros(3), enu_from_camera(0.0, -1.0, 0.0))
FRAMES, INTERVAL = 34, 8


def _packets(codec):
    rng, picture = np.random.default_rng(2), np.zeros((144, 256, 3), dtype=np.uint8)
    encoder, packets = Encoder(codec, 256, 144, 10.0, 3e5, INTERVAL), []
    for i in range(FRAMES):
        picture = np.roll(picture, 3, axis=1)
        picture[10:60, 20:50] = rng.integers(0, 255, (50, 30, 3))
        encoded = encoder.encode(picture, i)
        packets.append(
            Packet("a", "d", i, i, i, 1, 10, encoded.keyframe, POSE, encoded.data, sequence=i)
        )  # fmt: skip
    return packets


@pytest.mark.parametrize("codec", available_codecs())
def test_whatever_is_known_the_rest_decodes_to_the_same_pixels(codec):
    packets = _packets(codec)
    decoder = Decoder(codec)
    pixels = [decoder.decode(packet.data) for packet in packets]
    rng = np.random.default_rng(5)
    prefixes = [set(range(n)) for n in (0, 1, INTERVAL, INTERVAL + 1, 29, FRAMES)]
    scattered = [set(np.flatnonzero(rng.random(FRAMES) < share).tolist()) for share in (0.2, 0.5, 0.9, 0.97)]
    for known in (*prefixes, *scattered):
        sent, fresh = {}, Decoder(codec)

        def deliver(detector, message, sent=sent, fresh=fresh):
            sent[message.sequence] = fresh.decode(message.data)

        missing = WhatIsMissing(deliver, lambda message, known=known: message.sequence in known)
        for packet in packets:
            missing("d", packet)
        assert set(range(FRAMES)) - known <= sent.keys()
        for sequence, image in sent.items():
            np.testing.assert_array_equal(image, pixels[sequence])


def test_what_is_known_up_to_a_key_frame_is_not_sent_at_all():
    packets, sent = _packets("h264"), []
    missing = WhatIsMissing(lambda _, m: sent.append(m.sequence), lambda m: m.sequence < 3 * INTERVAL + 2)
    for packet in packets:
        missing("d", packet)
    missing("d", EndOfStream("a", "d", 0, FRAMES))
    assert sent == list(range(3 * INTERVAL, FRAMES + 1))


def test_each_detector_has_what_it_lacks():
    sent = []
    missing = WhatIsMissing(lambda d, m: sent.append((d, m.sequence)), lambda m: m.detector == "known")
    for packet in _packets("h264")[:4]:
        for detector in ("known", "new"):
            missing(
                detector, Packet(**{f: getattr(packet, f) for f in Packet.__slots__} | {"detector": detector})
            )
    assert sent == [("new", i) for i in range(4)]
