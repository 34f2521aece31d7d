"""Pictures are sent as large as the largest network wants them, and never larger than they are."""

import pytest

from pipeline.mission.sent_size import sent_size


@pytest.mark.parametrize(
    ("picture", "wanted", "size"),
    [
        ((3840, 2160), [(320, 176), (1024, 576)], (1024, 576)),
        ((3840, 2160), [(640, 640)], (1138, 640)),
        ((1024, 576), [(1024, 576)], (1024, 576)),
        ((1920, 1080), [(1024, 576)], (1920, 1080)),
        ((3840, 2160), [(640, 384), None], (3840, 2160)),
        ((3840, 2160), [], (3840, 2160)),
        ((97, 65), [(640, 640)], (96, 64)),
        ((2160, 3840), [(320, 176)], (320, 570)),
    ],
)
def test_no_network_has_to_enlarge_and_less_than_half_is_not_worth_a_scaling(
    picture: tuple[int, int], wanted: list[tuple[int, int] | None], size: tuple[int, int]
) -> None:
    assert sent_size(picture, wanted) == size
