"""Random fields: smooth waves over the plane and periodic textures of a wanted spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FloatArray

Float32Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Waves:
    """A smooth random function of the plane: a sum of cosines.

    wave_vectors: float64 (N, 2), rad/m. phases: float64 (N,), rad. amplitudes: float64 (N,).
    """

    wave_vectors: FloatArray
    phases: FloatArray
    amplitudes: FloatArray

    def __call__(self, east_m: FloatArray, north_m: FloatArray) -> FloatArray:
        """Values at positions; arrays of one shape."""
        total = np.zeros(np.shape(east_m))
        for (kx, ky), phase, amplitude in zip(self.wave_vectors, self.phases, self.amplitudes, strict=True):
            total += amplitude * np.cos(kx * east_m + ky * north_m + phase)
        return total


def random_waves(
    rng: np.random.Generator, shortest_m: float, longest_m: float, deviation: float, count: int = 32
) -> Waves:
    """Waves with lengths between two bounds; longer ones are higher. deviation: of the values."""
    lengths = np.geomspace(shortest_m, longest_m, count)
    angles = rng.uniform(0.0, 2.0 * np.pi, count)
    vectors = 2.0 * np.pi / lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    amplitudes = lengths * rng.uniform(0.5, 1.0, count)
    amplitudes *= deviation / np.sqrt(0.5 * np.sum(amplitudes**2))
    return Waves(vectors, rng.uniform(0.0, 2.0 * np.pi, count), amplitudes)


def tile_noise(
    rng: np.random.Generator, size: int, slope: float, low: float = 1.0, high: float = 1e9
) -> Float32Array:
    """A periodic field (size, size) of mean 0 and deviation 1 with spectrum f^-slope.

    low, high: the band of frequencies that it holds, cycles per tile.
    """
    fy = np.fft.fftfreq(size, 1.0 / size)[:, None]
    fx = np.fft.rfftfreq(size, 1.0 / size)[None, :]
    frequency = np.hypot(fx, fy)
    gain = np.where((frequency >= low) & (frequency <= high), np.maximum(frequency, 1.0) ** -slope, 0.0)
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) * gain, s=(size, size))
    field -= field.mean()
    return np.asarray(field / field.std(), dtype=np.float32)
