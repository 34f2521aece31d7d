"""What can happen to a file: seeded, for the tests of its readers."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager

SCRAPS = (
    b"\0",
    b"\xff",
    b"\xff\xfe",
    b'"',
    b";",
    b",,",
    b"\n\n",
    b"nan",
    b"1e999",
    b"-",
    b"9" * 400,
    b"\t",
    b"\r",
    b"58.4",
)


def mutated(data: bytes, chance: random.Random) -> bytes:
    """One to eight bytes, scraps, lines or ends changed."""
    result = bytearray(data)
    for _ in range(chance.randint(1, 8)):
        at = chance.randrange(len(result) + 1)
        kind = chance.randrange(6)
        if kind == 0 and result:
            result[at % len(result)] = chance.randrange(256)
        elif kind == 1:
            result[at:at] = chance.choice(SCRAPS)
        elif kind == 2:
            del result[at : at + chance.randint(1, 80)]
        elif kind == 3:
            del result[at:]
        elif kind == 4:
            result[at:at] = result[at : at + chance.randint(1, 200)]
        else:
            lines = bytes(result).split(b"\n")
            chance.shuffle(lines)
            result = bytearray(b"\n".join(lines))
    return bytes(result)


class Longest:
    """The longest of many readings, seconds of the processor (not of the clock: other tests run beside it)."""

    def __init__(self, most_s: float) -> None:
        self.most_s, self.seconds = most_s, 0.0

    @contextmanager
    def of(self, name: object) -> Iterator[None]:
        """Time what happens inside; fail, with the name, if it took longer than the most."""
        started = time.process_time()
        yield
        took_s = time.process_time() - started
        self.seconds = max(self.seconds, took_s)
        assert took_s < self.most_s, f"{name}: {took_s:.1f} s"
