"""A small finished search: a hill, two drones, three found places, four people, one of them missed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from pipeline.allocation.plan import Assignment, Plan
from pipeline.fusion.error_ellipse import ellipse_of
from pipeline.fusion.salient import SalientLocation
from pipeline.fusion.voxel_map import VoxelMap
from pipeline.geo.frame import LocalFrame
from pipeline.geo.terrain import Terrain
from pipeline.ingest.in_file import InFile
from pipeline.messages import FloatArray
from pipeline.outputs.accounting import StreamAccount
from pipeline.outputs.place_picture import PlacePicture
from pipeline.outputs.report import ReportData
from pipeline.outputs.summary import Latency, LinkUse, SubstreamCount, Summary
from pipeline.outputs.truth import TruePerson, match_truth

START_NS = 1_777_629_600_000_000_000  # 2026-05-01T10:00:00Z
FRAME = LocalFrame(63.4, 10.4)


@dataclass(frozen=True)
class Size:
    """Of the synthetic map."""

    rows: int = 60
    columns: int = 80
    cell_m: float = 0.5


SIZE = Size()


def terrain_of(size: Size) -> Terrain:
    """Rolling ground; the height of the first row and column is unknown."""
    north, east = np.mgrid[: size.rows, : size.columns] * size.cell_m
    heights = 4.0 * np.sin(north / 17.0) + 3.0 * np.cos(east / 23.0) + 120.0
    heights[0], heights[:, 0] = np.nan, np.nan
    return Terrain(
        FRAME,
        -0.5 * size.columns * size.cell_m,
        -0.5 * size.rows * size.cell_m,
        size.cell_m,
        heights.astype(np.float32),
    )


def map_of(size: Size, places: FloatArray) -> VoxelMap:
    """Looked at everywhere but in the eastern tenth; evidence of a person within 0.8 m of each place."""
    voxel_map = VoxelMap(terrain_of(size), 0.1192, 0.971)
    rows, columns = np.nonzero(np.isfinite(voxel_map.terrain.heights_m))
    seen = columns < 0.9 * size.columns
    rows, columns = rows[seen], columns[seen]
    voxel_map.update(rows, columns, -0.6 - 0.4 * np.sin(columns / 9.0))
    centers = voxel_map.terrain.centers(rows, columns)
    for place in places:
        near = np.linalg.norm(centers[:, :2] - place[:2], axis=1) < 0.8
        for _ in range(8):
            voxel_map.update(rows[near], columns[near], np.full(int(near.sum()), 0.9))
    return voxel_map


def location(number: int, east_m: float, north_m: float, probability: float = 0.95) -> SalientLocation:
    latitude, longitude = FRAME.wgs84_from_enu(np.array(east_m), np.array(north_m))
    return SalientLocation(
        id=number,
        class_name="person",
        probability=probability,
        position_enu=np.array([east_m, north_m, 121.0]),
        latitude_deg=float(latitude),
        longitude_deg=float(longitude),
        height_m=121.0,
        error=ellipse_of(np.array([[0.09, 0.03], [0.03, 0.04]])),
        spread_m=0.31,
        cells=9,
        looks=14 + number,
        first_seen_ns=START_NS + number * 3_000_000_000,
        last_seen_ns=START_NS + number * 5_000_000_000,
        streams=("drone-1", "drone-2"),
    )


def standing(name: str, east_m: float, north_m: float) -> TruePerson:
    return TruePerson(name, np.array([[east_m, north_m]]))


def serpentine(size: Size, phase: float) -> FloatArray:
    width, depth = 0.4 * size.columns * size.cell_m, 0.45 * size.rows * size.cell_m
    t = np.linspace(0.0, 1.0, 200)
    return np.stack([width * np.sin(9.0 * t + phase), depth * (2.0 * t - 1.0), np.full(200, 140.0)], axis=1)


def summary_of(locations: tuple[SalientLocation, ...], truth: tuple[TruePerson, ...]) -> Summary:
    plan = Plan(
        "optimal",
        1.23,
        1.23,
        0.0,
        2,
        (
            Assignment("drone-1", "laptop:small", "small", "laptop", "van", 2, 0, 4e6),
            Assignment("drone-2", "jetson:nano", "nano", "jetson", "drone-2", 1, 0, 1e6),
        ),
        0.05,
        120,
        80,
    )
    return Summary(
        mission="Bear <valley> & creek",
        mission_file="missions/bear.yaml",
        pace="max",
        seconds=31.25,
        video_seconds=60.0,
        plan=plan,
        streams=[
            StreamAccount("drone-1", 1800, 300, {"not_sampled": 1200, "not_assigned": 295, "link_full": 5}),
            StreamAccount("drone-2", 1800, 600, {"not_sampled": 1200}),
        ],
        substreams=[
            SubstreamCount(
                "drone-1",
                "laptop:small",
                "laptop",
                "van",
                305,
                300,
                {"link_full": 5},
                41,
                {
                    "encode": Latency(0.003, 0.005, 0.01),
                    "transfer": Latency(0.041, 0.05, 0.1),
                    "decode": Latency(0.001, 0.001, 0.0025),
                    "detect": Latency(0.05, 0.05, 0.1),
                },
            ),
            SubstreamCount("drone-2", "jetson:nano", "jetson", "drone-2", 600, 600, {}, 77),
        ],
        links=[
            LinkUse("drone-1", "van", 4e6, 14_500_000, 60.0),
            LinkUse("drone-2", "drone-2", float("inf"), 7_000_000, 60.0),
        ],
        locations=locations,
        match=match_truth(locations, truth) if truth else None,
        not_taken={"late": 2, "box without area": 1},
        provenance={"python": "3.11.2", "searchlight": "0.1.0"},
    )


def search_of(found: bool = True, known: bool = True, size: Size = SIZE) -> ReportData:
    """known: whether the truth is."""
    reach = np.array([size.columns, size.rows]) * 0.5 * size.cell_m
    spots = np.array([[-0.6, -0.5], [0.1, 0.4], [0.5, -0.2]]) * reach
    locations = (
        tuple(location(k + 1, *spot, 0.97 - 0.03 * k) for k, spot in enumerate(spots)) if found else ()
    )
    truth = (
        standing("sitting man", *(spots[0] + 0.2)),
        TruePerson("walker", spots[1] + np.array([[0.3, -0.1], [1.4, 0.6], [2.0, 2.0]])),
        standing("half hidden", *(spots[2] + (5.0, 5.0))),
    )
    truth = truth if known else ()
    tracks = {"drone-1": serpentine(size, 0.0), "drone-2": serpentine(size, 1.7)}
    schedule = Figure(figsize=(6, 1.5))
    schedule.add_subplot().barh([0, 1], [2, 3])
    at = InFile("DJI_0001.MP4", 65.4, 1962)
    pictures = [
        PlacePicture(k, b"\x89PNG %d" % k, "drone-1", START_NS + k * 1_000_000_000, at if k == 1 else None)
        for k in ((1, 2) if found else ())
    ]
    return ReportData(
        summary_of(locations, truth),
        map_of(size, spots if found else np.zeros((0, 2))),
        tracks,
        truth,
        schedule,
        pictures,
        time_zone="Europe/Oslo",
    )
