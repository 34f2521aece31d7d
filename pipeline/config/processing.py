"""What a plan may do: how often, how late, how many detectors, at which bitrates."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.config.base import Strict
from pipeline.config.units import Bitrate, Bytes, Fraction, Hertz, PositiveSeconds
from pipeline.link.codec import Codec


class Delays(Strict):
    """What a frame's way to a detector takes beside execution; within a site nothing."""

    encode: PositiveSeconds
    """Encoding one picture. Example: `{milliseconds: 20}`."""
    decode: PositiveSeconds
    """Decoding one picture. Example: `{milliseconds: 10}`."""
    burst: float = Field(default=1.0, ge=1.0, le=1000.0)
    """The largest packet of a stream, in mean packets of it."""


class Processing(Strict):
    """What a plan may do. The paper's names stand in brackets; what goes past the paper is off unless asked for."""

    frame_rate: Hertz
    """Pictures of each stream that are looked at in a second (processingFrameRate). Example: `{hertz: 2}`."""
    max_processing_time: PositiveSeconds
    """From a picture's capture to its detections, at most (maxProcessingTime). Example: `{seconds: 1}`."""
    detectors_per_stream: int = Field(default=2, ge=1, le=16)
    """At most (detPerStream)."""
    detectors_per_frame: int = Field(default=2, ge=1, le=16)
    """At most (detPerFrame)."""
    accuracy_weight: Fraction = 0.6
    """Of accuracy against few sites: the objective's w."""
    memory_rule: Literal["ram", "one_detector_per_machine"] = "ram"
    """`ram`: the detectors of a machine fit its memory together; `one_detector_per_machine`: as it says."""
    codec: Codec = "h264"
    """Of the video that is sent over links."""
    bitrates: tuple[Bitrate, ...] = Field(min_length=1)
    """That a stream may be sent at; the plan chooses among those that the pool has accuracies for or between.
    Example: `[{mbps: 1}, {mbps: 4}]`.
    """
    time_limit: PositiveSeconds = 30.0
    """For planning; after it the best plan found is taken."""
    codecs: tuple[Codec, ...] = ()
    """The plan chooses one of them per substream, by the pool's `accuracy_by_codec`. Absent: `codec` for all.
    Example: `[h264, h265]`.
    """
    expected_size: bool = False
    """Takes accuracies for the size of a person that is to be expected in each stream."""
    sharing: bool = False
    """Detectors that share a machine slow each other down, as the pool has it."""
    delays: Delays | None = None
    """If given, `max_processing_time` includes encoding, transfer and decoding."""
    keep_unsent: Bytes | None = None
    """Of pictures that no link could take, on the source's disk, in real time: they are sent when it can. Absent: none.
    Example: `{megabytes: 500}`.
    """
    detectors_in: Literal["threads", "processes"] = "threads"
    """Where a machine's detectors run, on Ray: threads of one process, or each a process of its own, whose crash costs
    its own substreams alone. The map is the same.
    """
    decoding_threads: int | None = Field(default=None, ge=1, le=64)
    """Of each video. Absent: the processor's cores, shared out among the streams. Example: `2`."""
