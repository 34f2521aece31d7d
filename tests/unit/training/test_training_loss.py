from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the extra [train] is not installed")

from pipeline.training.loss import Targets, box_loss, generalized_iou, heat_loss  # noqa: E402

NOBODY = np.zeros((0, 4))


def targets(people: list[list[float]], ignored: list[list[float]] = (), stride: int = 8) -> Targets:
    return Targets.of(
        [np.array(people, float).reshape(-1, 4)], [np.array(ignored, float).reshape(-1, 4)], 64, 96, stride
    )


def test_heat_is_one_at_the_cell_of_each_centre_and_nowhere_else():
    heat = targets([[8, 8, 24, 40], [60, 30, 70, 50]]).heat[0]
    assert torch.nonzero(heat == 1.0).tolist() == [[3, 2], [5, 8]]
    assert heat.min() == 0.0


def test_people_that_share_a_cell_at_stride_8_have_their_own_at_4():
    beside = [[33, 16, 36, 24], [36, 16, 39, 24]]
    assert int((targets(beside).heat == 1.0).sum()) == 1
    assert int((targets(beside, stride=4).heat == 1.0).sum()) == 2


def test_a_taller_box_has_taller_heat():
    heat = targets([[40, 0, 48, 64]]).heat[0]
    assert (heat[:, 5] > 0).sum() > (heat[4] > 0).sum()


def test_cells_near_a_centre_learn_the_box_of_the_nearer_person():
    t = targets([[8, 8, 40, 40], [40, 8, 72, 40]])
    assert t.boxes[0, :, 3, 3].tolist() == [8, 8, 40, 40]
    assert t.boxes[0, :, 3, 7].tolist() == [40, 8, 72, 40]
    assert t.box_weight[0, 3, 3] == 1.0


def test_nobody_is_no_heat_and_everything_is_learned():
    t = targets([])
    assert t.heat.abs().sum() == 0.0
    assert t.care.min() == 1.0
    assert box_loss(torch.rand(1, 4, 8, 12), t) == 0.0


def test_a_claim_over_an_ignored_person_costs_nothing():
    t = targets([], ignored=[[20, 20, 36, 44]])
    claims = torch.where(t.care == 0.0, 5.0, -20.0)
    assert (t.care == 0.0).any()
    assert heat_loss(claims, t) < 1e-6
    assert heat_loss(claims, targets([])) > 1.0


def test_the_right_answer_has_no_loss():
    t = targets([[8, 8, 24, 40]])
    right = torch.where(t.heat == 1.0, 20.0, -20.0)
    assert heat_loss(right, t) < 1e-6
    assert box_loss(t.boxes, t) < 1e-6
    assert box_loss(t.boxes + 3.0, t) > 0.1


@pytest.mark.parametrize(
    ("other", "expected"),
    [
        ([0, 0, 2, 2], 1.0),
        ([1, 0, 3, 2], 1 / 3),
        ([0, 0, 1, 1], 1 / 4),
        ([4, 0, 6, 2], 0.0 - 4 / 12),
        ([2, 2, 4, 4], 0.0 - 8 / 16),
    ],
)
def test_generalized_iou_of_known_boxes(other, expected):
    a = torch.tensor([[0.0, 0.0, 2.0, 2.0]])
    assert generalized_iou(a, torch.tensor([other], dtype=torch.float32)).item() == pytest.approx(expected)
