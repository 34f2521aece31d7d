from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra [train] is not installed")
pytest.importorskip("onnx", reason="the extra [train] is not installed")

from pipeline.detection import load_detector  # noqa: E402
from pipeline.detection.session import Session  # noqa: E402
from pipeline.training.export import export_onnx  # noqa: E402
from pipeline.training.network import (  # noqa: E402
    DecodedNetwork,
    PersonNetwork,
    boxes_of,
)
from pipeline.training.network_params import NetworkParams  # noqa: E402

PARAMS = NetworkParams(channels=(4, 8, 8, 16), blocks=(1, 1), head=8)


def trained_a_little(seed: int = 0, stride: int = 8) -> PersonNetwork:
    """A network whose normalisations have seen something."""
    torch.manual_seed(seed)
    network = PersonNetwork(PARAMS.model_copy(update={"stride": stride}))
    for _ in range(3):
        network(torch.rand(2, 3, 64, 96))
    return network.eval()


@pytest.mark.parametrize("stride", [8, 4])
def test_the_grid_has_the_stride_and_distances_are_positive(stride):
    logits, distances = trained_a_little(stride=stride)(torch.rand(2, 3, 64, 96))
    assert logits.shape == (2, 64 // stride, 96 // stride)
    assert distances.shape == (2, 4, 64 // stride, 96 // stride)
    assert (distances > 0).all()


@pytest.mark.parametrize("stride", [8, 4])
def test_boxes_reach_from_the_cells_centre_by_the_distances(stride):
    distances = torch.zeros(1, 4, 3, 5)
    distances[0, :, 2, 1] = torch.tensor([1.0, 2.0, 0.5, 0.25])
    box = boxes_of(distances, stride)[0, :, 2, 1] / stride
    np.testing.assert_allclose(box, [1.5 - 1, 2.5 - 2, 1.5 + 0.5, 2.5 + 0.25])


@pytest.mark.parametrize("stride", [8, 4])
def test_the_export_equals_torch(tmp_path, stride):
    network = trained_a_little(stride=stride)
    path = tmp_path / "net.onnx"
    export_onnx(network, path, width=96, height=64, name="net", trained_on="squares")
    image = np.random.default_rng(0).integers(0, 256, (1, 64, 96, 3), dtype=np.uint8)
    outputs = Session(path, threads=1, provider="cpu").run({"image": image})
    boxes, scores = outputs["boxes"], outputs["scores"]
    with torch.no_grad():
        expected_boxes, expected_scores = DecodedNetwork(network)(torch.from_numpy(image))
    np.testing.assert_allclose(boxes, expected_boxes, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(scores, expected_scores, atol=1e-4)


def test_the_export_is_recognised_as_ours_and_leaves_nothing_else(tmp_path):
    path = tmp_path / "net.onnx"
    export_onnx(trained_a_little(), path, width=96, height=64, name="net", trained_on="squares")
    detector = load_detector(path, score_threshold=0.0)
    boxes, scores, _ = detector.detect(np.zeros((576, 1024, 3), np.uint8))
    assert detector.recognised.name == "searchlight"
    assert detector.recognised.facts.metadata["trained_on"] == "squares"
    assert len(boxes) == len(scores) > 0
    assert [p.name for p in tmp_path.iterdir()] == ["net.onnx"]
