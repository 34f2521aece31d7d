"""The person detector: a small residual network with one output grid at stride 8 or 4, free of anchors."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.training.network_params import NetworkParams

#: exp of this many strides is far beyond any picture; it keeps the first steps of a training finite
_LARGEST_LOG_DISTANCE = 5.0
_RARE_PERSON = 0.01
_USUAL_DISTANCE_STRIDES = 2.0


class PersonNetwork(nn.Module):
    """Picture (B, 3, H, W) in 0..1 -> logits (B, h, w), distances (B, 4, h, w); H, W multiples of 16.

    h = H / stride, w = W / stride. Each cell says whether a person's box is centred there, and how far in
    strides the box reaches from the cell's centre to the left, up, to the right and down. Features at stride
    16 widen the view and come back.
    """

    def __init__(self, params: NetworkParams) -> None:
        super().__init__()
        c2, c4, c8, c16 = params.channels
        self.stride = params.stride
        self.stem = nn.Sequential(_convolution(3, c2, 2), _convolution(c2, c4, 2))
        self.fine = nn.Sequential(_convolution(c4, c8, 2), *(_Residual(c8) for _ in range(params.blocks[0])))
        self.wide = nn.Sequential(
            _convolution(c8, c16, 2), *(_Residual(c16) for _ in range(params.blocks[1]))
        )
        self.back = _convolution(c16, c8, 1, size=1)
        if params.stride == 4:
            self.further_back = _convolution(c8, c4, 1, size=1)
        self.head = _convolution(c4 if params.stride == 4 else c8, params.head, 1)
        self.out = nn.Conv2d(params.head, 5, 1)
        bias = torch.full((5,), _USUAL_DISTANCE_STRIDES).log()
        bias[0] = torch.logit(torch.tensor(_RARE_PERSON))
        self.out.bias = nn.Parameter(bias)

    def forward(self, picture: Tensor) -> tuple[Tensor, Tensor]:
        """See the class."""
        return self.readings(self.features(picture))

    def features(self, picture: Tensor) -> Tensor:
        """(B, head, h, w): nearly all of the work, good enough in half precision."""
        stem = self.stem(picture)
        fine = self.fine(stem)
        merged = fine + _doubled(self.back(self.wide(fine)))
        if self.stride == 4:
            merged = stem + _doubled(self.further_back(merged))
        features: Tensor = self.head(merged)
        return features

    def readings(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Logits and distances of features."""
        out = self.out(features)
        return out[:, 0], out[:, 1:].clamp(max=_LARGEST_LOG_DISTANCE).exp()


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _convolution(channels, channels, 1)
        norm = nn.BatchNorm2d(channels)
        # begins as the identity (arXiv:1706.02677, section 5.1), also when added to a trained network
        nn.init.zeros_(norm.weight)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, padding=1, bias=False), norm)

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


def _convolution(channels_in: int, channels_out: int, stride: int, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(channels_in, channels_out, size, stride, padding=size // 2, bias=False),
        nn.BatchNorm2d(channels_out),
        nn.ReLU(inplace=True),
    )


def _doubled(features: Tensor) -> Tensor:
    return functional.interpolate(features, scale_factor=2.0, mode="nearest")


def boxes_of(distances: Tensor, stride: int) -> Tensor:
    """Boxes (B, 4, h, w) xyxy in input pixels, of distances (B, 4, h, w) in strides from each centre."""
    rows, columns = distances.shape[2:]
    y = (torch.arange(rows, dtype=distances.dtype) + 0.5)[None, :, None].expand(1, rows, columns)
    x = (torch.arange(columns, dtype=distances.dtype) + 0.5)[None, None, :].expand(1, rows, columns)
    left, up, right, down = distances.unbind(1)
    return torch.stack([x - left, y - up, x + right, y + down], dim=1) * stride


class DecodedNetwork(nn.Module):
    """What is exported: uint8 (1, H, W, 3) RGB -> boxes (1, N, 4) xyxy in its pixels, scores (1, N)."""

    def __init__(self, network: PersonNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """See the class."""
        logits, distances = self.network(image.permute(0, 3, 1, 2).to(torch.float32) / 255.0)
        return boxes_of(distances, self.network.stride).flatten(2).transpose(1, 2), logits.flatten(
            1
        ).sigmoid()
