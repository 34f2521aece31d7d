"""Each codec: one packet per picture at once, the same bytes every time, at the asked quality and rate."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.link import codec as codec_module
from pipeline.link.codec import Decoder, Encoded, Encoder, available_codecs, require_codec

WIDTH, HEIGHT, RATE_HZ = 320, 192, 30.0
CODECS = available_codecs()


def smooth(index: int) -> NDArray[np.uint8]:
    """A smooth pattern that moves, its mean brightness telling the number of the picture."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    waves = [np.sin((x + 3 * index) / 25), np.cos((y - 2 * index) / 20), np.sin((x + y + index) / 40)]
    return np.clip(90 + 50 * np.stack(waves, axis=2) + index, 0, 255).astype(np.uint8)


def noisy(index: int) -> NDArray[np.uint8]:
    """A window that moves over noise of 4 x 4 pixel blocks."""
    blocks = np.random.default_rng(1).integers(30, 226, (100, 140, 3), dtype=np.uint8)
    texture = blocks.repeat(4, axis=0).repeat(4, axis=1)
    return np.ascontiguousarray(texture[index : index + HEIGHT, 2 * index : 2 * index + WIDTH])


def encode(
    codec: str, images: list[NDArray[np.uint8]], bitrate_bps: float = 2e6, every: int = 30
) -> list[Encoded]:
    encoder = Encoder(codec, WIDTH, HEIGHT, RATE_HZ, bitrate_bps, every)  # type: ignore[arg-type]
    return [encoder.encode(image, index) for index, image in enumerate(images)]


def psnr_db(image: NDArray[np.uint8], reference: NDArray[np.uint8]) -> float:
    error = np.mean((image.astype(np.float64) - reference) ** 2)
    return float(10 * np.log10(255**2 / error))


@pytest.mark.parametrize("codec", CODECS)
def test_each_picture_comes_back_from_its_own_packet(codec: str) -> None:
    images = [smooth(index) for index in range(30)]
    decoder = Decoder(codec)  # type: ignore[arg-type]
    for index, packet in enumerate(encode(codec, images)):
        picture = decoder.decode(packet.data)
        assert packet.pts == index
        assert (picture.shape, picture.dtype) == ((HEIGHT, WIDTH, 3), np.uint8)
        assert psnr_db(picture, images[index]) > 28.0
        # not the one before: realtime VP9 and AV1 leave blocks that hardly changed as they were
        assert psnr_db(picture, images[index]) > psnr_db(picture, images[index - 3])


@pytest.mark.parametrize("codec", CODECS)
def test_the_same_pictures_give_the_same_bytes(codec: str) -> None:
    images = [noisy(index) for index in range(15)]
    assert encode(codec, images) == encode(codec, images)


@pytest.mark.parametrize("codec", CODECS)
def test_keyframes_come_at_the_interval_and_when_forced_and_decoding_can_start_there(codec: str) -> None:
    encoder = Encoder(codec, WIDTH, HEIGHT, RATE_HZ, 2e6, 10)  # type: ignore[arg-type]
    packets = [encoder.encode(smooth(index), index, keyframe=index == 4) for index in range(12)]
    assert [packet.pts for packet in packets if packet.keyframe][:2] == [0, 4]
    assert sum(packet.keyframe for packet in packets) == 2 + any(p.keyframe for p in packets[10:])
    picture = Decoder(codec).decode(packets[4].data)  # type: ignore[arg-type]
    assert psnr_db(picture, smooth(4)) > 28.0


@pytest.mark.parametrize("codec", CODECS)
def test_the_rate_follows_the_asked_one_on_hard_pictures(codec: str) -> None:
    sizes = [len(packet.data) for packet in encode(codec, [noisy(i) for i in range(60)], 1e6)]
    # h264 within 1.3; the others are measured in whole missions, here only kept from running away
    limit = 1.3 if codec == "h264" else 1.6
    assert 1e6 / limit < sum(sizes) * 8 / (60 / RATE_HZ) < 1e6 * limit


def test_no_h264_packet_takes_more_than_half_a_second_of_the_link() -> None:
    sizes = [len(packet.data) for packet in encode("h264", [noisy(i) for i in range(60)], 1e6)]
    assert max(sizes) * 8 / 1e6 <= 0.5


@pytest.mark.parametrize("codec", CODECS)
def test_a_slow_substream_works_too(codec: str) -> None:
    encoder, decoder = Encoder(codec, WIDTH, HEIGHT, 30 / 7, 1e5, 8), Decoder(codec)  # type: ignore[arg-type]
    assert float(1 / encoder.time_base) == pytest.approx(30 / 7)
    for index in range(10):
        assert (
            psnr_db(decoder.decode(encoder.encode(smooth(7 * index), index).data), smooth(7 * index)) > 25.0
        )


@pytest.mark.parametrize("codec", CODECS)
def test_a_packet_without_its_keyframe_cut_short_or_of_junk_is_refused(codec: str) -> None:
    first, second, third = encode(codec, [noisy(i) for i in range(3)])
    for junk in (b"", b"\x00\x01\x02" * 100, first.data[:20], second.data):
        with pytest.raises(ValueError, match="packet"):
            Decoder(codec).decode(junk)  # type: ignore[arg-type]
    decoder = Decoder(codec)  # type: ignore[arg-type]
    decoder.decode(first.data)
    with pytest.raises(ValueError, match="packet"):
        decoder.decode(b"\x00\x01\x02" * 100)
    decoder.decode(first.data)
    assert psnr_db(decoder.decode(second.data), noisy(1)) > psnr_db(noisy(2), noisy(1))
    decoder.decode(third.data)


def test_a_codec_missing_from_the_build_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(codec_module._ENCODERS, "av1", "libaom-av1")
    assert "av1" not in available_codecs()
    with pytest.raises(
        InputError, match=r"found av1, which this build of FFmpeg lacks; expected one of h264"
    ):
        require_codec("av1")


@pytest.mark.parametrize(
    ("size", "bitrate_bps"), [((321, 192), 1e6), ((320, 192), 0.0), ((320, 192), float("inf"))]
)
def test_an_odd_size_and_an_impossible_rate_are_refused(size: tuple[int, int], bitrate_bps: float) -> None:
    with pytest.raises(InputError):
        Encoder("h264", *size, RATE_HZ, bitrate_bps, 30)
