"""How large a network is. Apart from the network: a training file is read without torch."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from pipeline.config.base import Strict


class NetworkParams(Strict):
    """channels: at strides 2, 4, 8 and 16. blocks: residual blocks at strides 8 and 16. head: channels.

    stride: of the output grid; 4 for people of less than about 16 pixels of the input, who share cells at 8.
    """

    channels: tuple[int, int, int, int]
    blocks: tuple[int, int]
    head: int = Field(ge=4)
    stride: Literal[4, 8] = 8
