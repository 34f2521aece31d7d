"""With nothing named, the only mission here or a folder below is meant; never one of several."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.mission.find_mission import find_mission


def test_a_file_a_folder_and_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="searchlight init FOLDER"):
        find_mission(None, tmp_path)
    (tmp_path / "card").mkdir()
    (tmp_path / "card/mission.yaml").touch()
    assert find_mission(None, tmp_path) == tmp_path / "card/mission.yaml"
    assert find_mission(tmp_path / "card") == tmp_path / "card/mission.yaml"
    assert find_mission(tmp_path / "other.yaml") == tmp_path / "other.yaml"
    (tmp_path / "second").mkdir()
    (tmp_path / "second/mission.yaml").touch()
    with pytest.raises(InputError, match="2 missions"):
        find_mission(None, tmp_path)
    (tmp_path / "mission.yaml").touch()
    assert find_mission(None, tmp_path) == tmp_path / "mission.yaml"
