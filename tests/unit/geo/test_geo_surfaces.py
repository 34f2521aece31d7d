import numpy as np
import pytest
import trimesh

from pipeline.errors import InputError
from pipeline.geo.frame import LocalFrame
from pipeline.geo.surfaces import load_mesh, plane, sampled_mesh

FRAME = LocalFrame(47.0, 8.0)


def test_a_plane_has_one_height_everywhere_in_its_rectangle():
    terrain = plane(FRAME, -10.0, -5.0, 10.0, 5.2, 0.5, 12.5)
    assert terrain.shape == (21, 40)
    assert terrain.height(-9.9, 5.1) == 12.5
    assert np.isnan(terrain.height(10.1, 0.0))


def test_a_slanted_mesh_has_the_heights_of_its_plane():
    corners = np.array([[0.0, 0.0, 1.0], [20.0, 0.0, 3.0], [20.0, 30.0, 0.0], [0.0, 30.0, -2.0]])
    terrain = sampled_mesh(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]]), FRAME, 0.5)
    assert terrain.shape == (60, 40)
    for east, north in [(1.0, 1.0), (10.3, 15.2), (19.5, 29.0)]:
        assert terrain.height(east, north) == pytest.approx(1.0 + 0.1 * east - 0.1 * north, abs=1e-4)


def test_the_highest_surface_counts_whatever_its_order_and_winding():
    box = trimesh.creation.box(
        extents=(4.0, 2.0, 3.0), transform=trimesh.transformations.translation_matrix((0, 0, 1.5))
    )
    ground = trimesh.creation.box(extents=(10.0, 10.0, 0.2))
    for meshes in ([box, ground], [ground, box]):
        mesh = trimesh.util.concatenate(meshes)
        mesh.invert()
        terrain = sampled_mesh(mesh, FRAME, 0.25)
        assert terrain.height(0.0, 0.0) == pytest.approx(3.0)
        assert terrain.height(3.0, 0.0) == pytest.approx(0.1, abs=1e-6)


def test_cells_without_a_surface_are_unknown():
    triangle = trimesh.Trimesh([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0]], [[0, 1, 2]])
    terrain = sampled_mesh(triangle, FRAME, 1.0)
    assert np.isfinite(terrain.heights_m[1, 1])
    assert np.isnan(terrain.heights_m[8, 8])
    assert np.isfinite(terrain.heights_m).sum() == pytest.approx(50, abs=6)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.Trimesh(),
        trimesh.Trimesh([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], [[0, 1, 2]]),
        trimesh.Trimesh([[0.0, 0.0, np.nan], [9.0, 0.0, 0.0], [0.0, 9.0, 0.0]], [[0, 1, 2]], validate=False),
    ],
    ids=["empty", "between the centres", "NaN"],
)
def test_a_mesh_without_a_surface_is_refused(mesh):
    with pytest.raises(InputError, match="mesh"):
        sampled_mesh(mesh, FRAME, 1.0)


@pytest.mark.parametrize("suffix", ["ply", "obj", "stl", "off", "glb"])
def test_a_mesh_file_is_read(tmp_path, suffix):
    box = trimesh.creation.box(extents=(8.0, 6.0, 4.0))
    box.export(tmp_path / f"mesh.{suffix}")
    terrain = load_mesh(tmp_path / f"mesh.{suffix}", 0.5, FRAME)
    assert terrain.shape == (12, 16)
    assert terrain.height(0.0, 0.0) == pytest.approx(2.0)


def test_a_file_that_is_no_mesh_is_refused_in_one_line(tmp_path):
    (tmp_path / "text.ply").write_text("no mesh")
    for name in ("none.ply", "text.ply"):
        with pytest.raises(InputError, match=name) as error:
            load_mesh(tmp_path / name, 0.5, FRAME)
        assert "\n" not in str(error.value)
