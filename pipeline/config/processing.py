"""What a plan may do: how often, how late, how many detectors, at which bitrates."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.config.base import Strict
from pipeline.config.units import Bitrate, Fraction, Hertz, PositiveSeconds
from pipeline.link.codec import Codec


class Delays(Strict):
    """What a frame's way to a detector takes beside execution; within a site nothing.

    burst: the largest packet, in mean packets of its stream.
    """

    encode: PositiveSeconds
    decode: PositiveSeconds
    burst: float = Field(default=1.0, ge=1.0, le=1000.0)


class Processing(Strict):
    """The paper's processingFrameRate, maxProcessingTime, detPerStream, detPerFrame, w; the memory rule.

    Past the paper, each off unless asked for. codecs: the plan chooses one per substream, by the pool's
    accuracy_by_codec; none: ``codec`` for all. expected_size: accuracies for the size of a person that is to
    be expected in each stream. sharing: detectors that share a machine slow each other down, as the pool has
    it. delays: max_processing_time includes encoding, transfer and decoding. decoding_threads: of each video;
    absent: the processor's cores, shared out among the streams.
    """

    frame_rate: Hertz
    max_processing_time: PositiveSeconds
    detectors_per_stream: int = Field(default=2, ge=1, le=16)
    detectors_per_frame: int = Field(default=2, ge=1, le=16)
    accuracy_weight: Fraction = 0.6
    memory_rule: Literal["ram", "one_detector_per_machine"] = "ram"
    codec: Codec = "h264"
    bitrates: tuple[Bitrate, ...] = Field(min_length=1)
    time_limit: PositiveSeconds = 30.0
    codecs: tuple[Codec, ...] = ()
    expected_size: bool = False
    sharing: bool = False
    delays: Delays | None = None
    decoding_threads: int | None = Field(default=None, ge=1, le=64)
