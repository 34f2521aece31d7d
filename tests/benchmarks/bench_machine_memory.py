"""Memory of machines with many detectors: 40 substreams, each with a decoder, a network of its own and a thread.

python -m tests.benchmarks.bench_machine_memory [--detectors 40] [--processes 4] [--pool configs/pools/simulated.yaml]

The detectors of the pool in turn, shared out among processes; each looks at ten decoded pictures of 1024 x 576. What is
printed is the proportional set size of all processes together, which counts shared pages once, at its highest.
"""

from __future__ import annotations

import argparse
import multiprocessing
import threading
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from pipeline.config.pool import PoolDetector, load_pool
from pipeline.detection import open_pool_detector
from pipeline.link.codec import Decoder, Encoder

PICTURES, SIZE = 10, (1024, 576)


def machine(rows: list[PoolDetector], packets: list[bytes], pipe: Connection) -> None:
    """Load, look, and stay until told."""
    detectors = [open_pool_detector(row) for row in rows]
    decoders = [Decoder("h264") for _ in rows]

    def work(k: int) -> None:
        for data in packets:
            detectors[k].detect(decoders[k].decode(data))

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(rows))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    pipe.send("looked")
    pipe.recv()


def pss_bytes(process: int) -> int:
    """Proportional set size."""
    lines = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith("Pss:"))


def measure(rows: list[PoolDetector], processes: int, packets: list[bytes]) -> int:
    """Bytes of all machines together."""
    context = multiprocessing.get_context("spawn")
    started = []
    for k in range(processes):
        ours, theirs = context.Pipe()
        process = context.Process(target=machine, args=(rows[k::processes], packets, theirs))
        process.start()
        started.append((process, ours))
    for _, pipe in started:
        assert pipe.recv() == "looked"
    total = sum(pss_bytes(process.pid or 0) for process, _ in started)
    for process, pipe in started:
        pipe.send("end")
        process.join()
    return total


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--detectors", type=int, default=40)
    parser.add_argument("--processes", type=int, default=4)
    parser.add_argument("--pool", type=Path, default=Path("configs/pools/simulated.yaml"))
    arguments = parser.parse_args()
    pool = [row for row in load_pool(arguments.pool).detectors if row.model is not None]
    encoder = Encoder("h264", *SIZE, 10.0, 4e6, 10)
    rng = np.random.default_rng(14)
    pictures = rng.integers(0, 256, (PICTURES, SIZE[1], SIZE[0], 3), dtype=np.uint8)
    packets = [encoder.encode(picture, k).data for k, picture in enumerate(pictures)]
    for count in (arguments.processes, arguments.detectors):
        rows = [pool[k % len(pool)] for k in range(count)]
        total = measure(rows, arguments.processes, packets)
        print(f"{count} detectors in {arguments.processes} processes: {total / 1e9:.2f} GB", flush=True)


if __name__ == "__main__":
    main()
