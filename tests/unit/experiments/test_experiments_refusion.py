import shutil

import pytest
import yaml

from pipeline.errors import InputError
from pipeline.experiments.refusion import prepare_with_truth


def test_an_experiment_needs_to_know_where_the_people_are(small_mission, tmp_path):
    folder = tmp_path / "mission"
    shutil.copytree(small_mission.parent, folder)
    document = yaml.safe_load((folder / "mission.yaml").read_text(encoding="utf-8"))
    del document["truth"]
    (folder / "mission.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    with pytest.raises(InputError, match="true places"):
        prepare_with_truth(folder / "mission.yaml")
