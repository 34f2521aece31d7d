"""Results per second of the reducer, and its memory: 50 streams at 10 Hz, two detectors each, 0.5 m cells.

Fifty drones fly straight lanes over 1.5 km x 1.5 km of the hills, trees and houses of bench_fusion, 15-40 m
up. Their results are packed as they travel and arrive up to a second late. Each shard is a process that
unpacks all of them, puts them into order and applies them to its tiles. They keep up if that takes less time
than was flown; beside the time stands what the processor worked, for a machine that others use too. The tiles
of all shards are compared with those of one reducer.

Run: python tests/benchmarks/bench_fusion_throughput.py [--seconds 20] [--shards 2]
"""

import argparse
import hashlib
import math
import multiprocessing
import resource
import time

import numpy as np
from bench_fusion import CAMERA, fusion_params, hilly_terrain

from pipeline.fusion.fuser import Fuser
from pipeline.fusion.sequencer import Sequencer
from pipeline.fusion.sharding import shares
from pipeline.geo.pose import enu_from_camera
from pipeline.geo.terrain import Terrain
from pipeline.messages import CameraPose, Detections, EndOfStream, pack, unpack
from pipeline.mission.stages.reducer import ReducerStage

STREAMS, RATE_HZ, DETECTORS = 50, 10.0, ("gpu:small", "nano:small")
CELL_M, COPIES, SPEED_MPS = 0.5, 6, 5.0
SIDE_M, MARGIN_M = 250.0 * COPIES, 60.0
LATENESS_NS = 2_000_000_000
START_NS = 1_777_629_600_000_000_000


def large_terrain():
    """The scene of bench_fusion and its mirror images side by side."""
    scene = hilly_terrain(CELL_M)
    heights = np.pad(scene.heights_m, (0, (COPIES - 1) * scene.shape[0]), mode="symmetric")
    return Terrain(scene.frame, 0.0, 0.0, CELL_M, heights)


def packed_results(terrain, seconds):
    """The wire form of all results, in the order of their arrival."""
    rng, arrivals = np.random.default_rng(3), []
    for k in range(STREAMS):
        start, yaw, up = rng.uniform(0.0, SIDE_M, 2), rng.uniform(0.0, 2.0 * math.pi), rng.uniform(15.0, 40.0)
        heading = np.array([math.sin(yaw), math.cos(yaw)])
        attitude = enu_from_camera(yaw, -math.pi / 4.0, 0.0)
        for i in range(int(seconds * RATE_HZ)):
            east, north = MARGIN_M + (start + SPEED_MPS * i / RATE_HZ * heading) % (SIDE_M - 2.0 * MARGIN_M)
            pose = CameraPose(np.array([east, north, terrain.height(east, north) + up]), attitude)
            time_ns = START_NS + int(i / RATE_HZ * 1e9) + k
            for detector in DETECTORS:
                result = _result(rng, f"drone-{k}", detector, i, time_ns, pose)
                arrivals.append((time_ns + rng.integers(0, 1_000_000_000), pack(result)))
    return [data for _, data in sorted(arrivals)]


def _result(rng, stream, detector, index, time_ns, pose):
    n = rng.poisson(0.5)
    corner = rng.uniform((50.0, 50.0), (900.0, 450.0), (n, 2))
    boxes = np.concatenate([corner, corner + rng.uniform(20.0, 60.0, (n, 2))], axis=1)
    scores, classes = rng.uniform(0.3, 1.0, n), np.zeros(n, dtype=np.int64)
    return Detections(stream, detector, index, time_ns, pose, boxes, scores, classes)


def reduce(terrain, owned, packed):
    """One shard, from the bytes to the tiles: its fuser, the seconds, and those of the processor."""
    streams = [f"drone-{k}" for k in range(STREAMS)]
    substreams = [(stream, detector) for stream in streams for detector in DETECTORS]
    cameras, accuracy = dict.fromkeys(streams, CAMERA), dict.fromkeys(DETECTORS, 0.9)
    fuser = Fuser(terrain, fusion_params(CELL_M), cameras, accuracy, owned=owned)
    stage = ReducerStage(fuser, Sequencer(substreams, LATENESS_NS), substreams)
    start, worked = time.perf_counter(), time.process_time()
    for data in packed:
        stage.push(unpack(data))
    for substream in substreams:
        stage.push(EndOfStream(*substream))
    assert sum(map(len, stage.processed.values())) == len(packed)
    return fuser, time.perf_counter() - start, time.process_time() - worked


def shard(terrain, owned, packed, barrier, reply):
    """The process of one shard: sends its times, its peak memory in MiB, and the digest of each tile."""
    reduce(terrain, owned, packed[: 4 * STREAMS])  # compiles
    barrier.wait()
    fuser, seconds, worked_s = reduce(terrain, owned, packed)
    tiles = fuser.map.tiles
    digests = {tile: hashlib.sha256(tiles.tile(*tile)).hexdigest() for tile in tiles.touched_tiles()}
    peak_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    reply.send((seconds, worked_s, peak_mib, digests, [(k.order, k.p) for k in fuser.looks]))


def run(terrain, packed, shards):
    """Times of the slowest shard, peak memory of all in MiB, all tiles' digests and all looks."""
    context, processes = multiprocessing.get_context("spawn"), []
    barrier = context.Barrier(shards)
    for owned in shares(terrain.shape, shards):
        mine, reply = context.Pipe()
        arguments = (terrain, owned, packed, barrier, reply)
        processes.append((context.Process(target=shard, args=arguments), mine))
        processes[-1][0].start()
    outcomes = [mine.recv() for _, mine in processes]
    for process, _ in processes:
        process.join()
    seconds, worked_s, peak_mib, digests, looks = zip(*outcomes, strict=True)
    every_tile = {tile: digest for part in digests for tile, digest in part.items()}
    assert len(every_tile) == sum(map(len, digests))
    all_looks = sorted(look for part in looks for look in part)
    return max(seconds), max(worked_s), sum(peak_mib), every_tile, all_looks


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--shards", type=int, default=2)
    arguments = parser.parse_args()
    terrain = large_terrain()
    packed = packed_results(terrain, arguments.seconds)
    size = np.mean([len(data) for data in packed])
    print(f"{len(packed)} results of {arguments.seconds:g} s, {size:.0f} bytes each")
    outcomes = []
    for shards in sorted({1, arguments.shards}):
        seconds, worked_s, peak_mib, tiles, looks = run(terrain, packed, shards)
        outcomes.append((tiles, looks))
        print(
            f"{shards} shard(s): {seconds:.1f} s, {len(packed) / seconds:.0f} results/s; "
            f"processor of the busiest {worked_s:.1f} s, {len(packed) / worked_s:.0f} results/s; "
            f"peak memory of all {peak_mib:.0f} MiB; {len(tiles)} tiles, {len(looks)} looks"
        )
    print(f"tiles and looks of all shards equal those of one: {all(o == outcomes[0] for o in outcomes)}")


if __name__ == "__main__":
    main()
