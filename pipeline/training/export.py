"""The trained network as an ONNX file that ``pipeline.detection`` opens."""

from __future__ import annotations

import os
from pathlib import Path

import onnx
import torch

from pipeline.training.config import Training
from pipeline.training.network import DecodedNetwork, PersonNetwork

_OPSET = 17


def export_onnx(
    network: PersonNetwork, path: Path, *, width: int, height: int, name: str, trained_on: str
) -> None:
    """Write the network in its evaluation form, decoding included, for pictures of height x width.

    trained_on: what it says of itself; a mission warns of ``simulated scenes``. The file appears under its
    name only when it is complete.
    """
    decoded = DecodedNetwork(network).eval()
    image = torch.zeros(1, height, width, 3, dtype=torch.uint8)
    partial = path.with_suffix(".part")
    torch.onnx.export(
        decoded,
        (image,),
        partial,
        input_names=["image"],
        output_names=["boxes", "scores"],
        opset_version=_OPSET,
        dynamo=False,
    )
    model = onnx.load(partial)
    onnx.helper.set_model_props(model, _metadata(width, height, name, trained_on))
    onnx.checker.check_model(model)
    partial.write_bytes(model.SerializeToString())
    os.replace(partial, path)


def export_trained(network: PersonNetwork, training: Training, path: Path) -> None:
    """Write the network of a training, of the size and under the name that it says."""
    size = training.input
    export_onnx(
        network,
        path,
        width=size.width,
        height=size.height,
        name=training.name,
        trained_on=training.trained_on,
    )


def _metadata(width: int, height: int, name: str, trained_on: str) -> dict[str, str]:
    return {
        "layout": "searchlight",
        "name": name,
        "input": f"uint8 RGB {width}x{height}",
        "normalisation": "none; values 0..255 are scaled in the graph",
        "classes": "person",
        "trained_on": trained_on,
    }
