"""Memory of a search over 1 % of 10 km x 10 km at 0.5 m: 4 x 10^8 cells, terrain and map on disk.

A surface model of hills is written at 4 m and read to the disk, and a drone sweeps 1 km x 1 km of it, 30 m
up, in lanes 15 m apart. Then the map is saved, people are looked for, saliency.tif is written and the map is
loaded again, all in one process that is not the one that made the surface model.

Run: python tests/benchmarks/bench_fusion_large.py --folder /somewhere/with/4/GB
"""

import argparse
import math
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
import rasterio
from bench_fusion import CAMERA, fusion_params
from rasterio.transform import from_origin

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.map_file import load_map, save_map
from pipeline.fusion.salient import salient_locations
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.surface_model import inspect
from pipeline.geo.terrain import frame_of, load_terrain
from pipeline.messages import CameraPose, Detections
from pipeline.outputs.saliency_tif import write_saliency

SIDE_M, CELL_M, SEARCHED_M, LANE_M, STEP_M, UP_M = 10_000.0, 0.5, 1_000.0, 15.0, 1.0, 30.0
PERSON = np.array([[500.0, 262.0, 520.0, 300.0]])
START_NS = 1_777_629_600_000_000_000


def write_surface_model(path, cell_m=4.0):
    """Hills of up to 40 m, strip by strip."""
    n = int(SIDE_M / cell_m)
    profile = {
        "driver": "GTiff",
        "dtype": "float32",
        "count": 1,
        "width": n,
        "height": n,
        "crs": "EPSG:32633",
    }
    corner = from_origin(500_000.0, 6_500_000.0, cell_m, cell_m)
    x = np.arange(n) * cell_m
    with rasterio.open(path, "w", transform=corner, tiled=True, **profile) as target:
        for row in range(0, n, 256):
            y = x[row : row + 256, None]
            heights = 20.0 * np.sin(x / 290.0) * np.cos(y / 340.0) + 4.0 * np.sin(x / 23.0 + y / 31.0)
            target.write(heights.astype(np.float32)[None], window=((row, row + len(y)), (0, n)))


def frames(terrain):
    """Results of one drone that goes up and down in lanes."""
    middle = np.array([terrain.east_m, terrain.north_m]) + np.array(terrain.shape[::-1]) * CELL_M / 2.0
    way = np.arange(0.0, SEARCHED_M, STEP_M)
    index = 0
    for lane in range(int(SEARCHED_M / LANE_M)):
        yaw = 0.0 if lane % 2 == 0 else math.pi
        attitude = enu_from_camera(yaw, -math.pi / 4.0, 0.0)
        for along in way if lane % 2 == 0 else way[::-1]:
            east, north = middle - SEARCHED_M / 2.0 + np.array([lane * LANE_M, along])
            pose = CameraPose(np.array([east, north, terrain.height(east, north) + UP_M]), attitude)
            boxes = PERSON if index % 2000 < 10 else PERSON[:0]
            scores, classes = np.full(len(boxes), 0.9), np.zeros(len(boxes), dtype=np.int64)
            yield Detections("a", "d", index, START_NS + index * 200_000_000, pose, boxes, scores, classes)
            index += 1


def mission(surface_model, folder, reply):
    """Read the terrain, search, save the map, write the results; sends times and peak memory as it goes."""
    start = time.perf_counter()

    def say(what):
        peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        reply.send(
            f"{what}: {time.perf_counter() - start:.0f} s since the start, peak memory {peak_mib:.0f} MiB"
        )

    terrain = load_terrain([inspect(surface_model)], CELL_M, frame_of(surface_model), folder=folder)
    say(f"terrain of {terrain.shape[0]} x {terrain.shape[1]} cells read to disk")
    params = fusion_params(CELL_M)
    fuser = Fuser(terrain, params, {"a": CAMERA}, {"d": 1.0}, folder=folder)
    count = sum(1 for frame in frames(terrain) if fuser.apply(frame) is None)
    tiles = fuser.map.tiles
    observed = sum(np.count_nonzero(tiles.tile(*tile)["observations"]) for tile in tiles.touched_tiles())
    share = observed / terrain.heights_m.size
    say(f"{count} frames applied, {observed} cells observed ({share:.2%}) in {tiles.touched.sum()} tiles")
    save_map(folder / "map.searchlight", fuser.map)
    say(f"map saved, {(folder / 'map.searchlight').stat().st_size / 2**20:.0f} MiB")
    locations = salient_locations(fuser.map, fuser.looks, params)
    write_saliency(folder / "saliency.tif", fuser.map)
    say(f"{len(locations)} places from {len(fuser.looks)} looks, saliency.tif written")
    again = Fuser(terrain, params, {"a": CAMERA}, {"d": 1.0}, folder=folder)
    load_map(folder / "map.searchlight", again.map)
    same = all(
        tiles.tile(*tile).tobytes() == again.map.tiles.tile(*tile).tobytes() for tile in tiles.touched_tiles()
    )
    say(f"map loaded beside it, equal: {same}")
    reply.send(None)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, required=True, help="on a disk with 4 GB of room")
    with tempfile.TemporaryDirectory(dir=parser.parse_args().folder) as name:
        folder = Path(name)
        write_surface_model(folder / "dsm.tif")
        context = multiprocessing.get_context("spawn")
        lines, reply = context.Pipe()
        process = context.Process(target=mission, args=(folder / "dsm.tif", folder, reply))
        process.start()
        while (line := lines.recv()) is not None:
            print(line, flush=True)
        process.join()


if __name__ == "__main__":
    main()
