"""A mission that names cover has it in its map: POD is lower there, and a bad layer is one line with exit code 2."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.errors import InputError
from pipeline.mission.input_files import input_digests
from pipeline.mission.local import make_reducer
from pipeline.mission.planning import plan
from pipeline.mission.prepared import prepare


def with_cover(small_mission: Path, folder: Path, *cover: dict) -> Path:
    document = yaml.safe_load(small_mission.read_text())
    document["cover"] = list(cover)
    for part in small_mission.parent.iterdir():
        if part.name != "mission.yaml":
            (folder / part.name).symlink_to(part)
    (folder / "mission.yaml").write_text(yaml.safe_dump(document))
    return folder / "mission.yaml"


def test_cover_of_the_mission_lowers_pod_where_it_lies(small_mission: Path, tmp_path: Path) -> None:
    frame = prepare(small_mission).frame
    lat, lon = frame.wgs84_from_enu(np.array([-500.0, 0.0]), np.array([-500.0, 500.0]))
    (west, east), (south, north) = (x.tolist() for x in (lon, lat))
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    (tmp_path / "wood.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    prepared = prepare(with_cover(small_mission, tmp_path, {"file": "wood.geojson", "hidden": 0.6}))
    voxel_map = make_reducer(prepared, plan(prepared), lateness=False).fuser.map
    rows, columns = np.indices(voxel_map.terrain.shape)
    voxel_map.tiles.touch(rows.ravel(), columns.ravel())
    voxel_map.tiles.cells["pod_before"] = 0.5
    pod = voxel_map.layer("pod")
    in_west = voxel_map.terrain.east_m + (columns + 0.5) * voxel_map.terrain.cell_m < 0.0
    np.testing.assert_allclose(pod, np.where(in_west, 0.5 * (1.0 - 0.6), 0.5), atol=1e-6)
    assert str((tmp_path / "wood.geojson").absolute()) in input_digests(prepared)


@pytest.mark.parametrize(
    ("cover", "said"),
    [
        ({"file": "none.geojson", "hidden": 0.5}, "none.geojson: found no file"),
        ({"file": "none.geojson"}, "the share of people hidden within the polygons"),
        ({"file": "canopy.tif", "hidden": 0.5}, "its values are the share"),
        ({"file": "wood.geojson", "hidden": 60}, "hidden"),
        ({"file": "terrain.tif"}, "terrain.tif"),
    ],
)
def test_a_layer_that_cannot_be_used_is_one_line(
    small_mission: Path, tmp_path: Path, cover: dict, said: str
) -> None:
    with pytest.raises(InputError, match=said) as fault:
        prepare(with_cover(small_mission, tmp_path, cover))
    assert fault.value.exit_code == 2
