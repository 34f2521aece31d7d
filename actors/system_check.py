"""After set-up: does every package load, and if a system library is missing, which package has it?"""

from __future__ import annotations

import importlib
import sys

PACKAGES = (
    "av",
    "embreex",
    "numba",
    "onnxruntime",
    "ortools",
    "pyproj",
    "rasterio",
    "ray",
    "scipy",
    "matplotlib",
)
#: system library -> Debian package
LIBRARIES = {
    "libstdc++.so.6": "libstdc++6",
    "libgomp.so.1": "libgomp1",
    "libgcc_s.so.1": "libgcc-s1",
    "libexpat.so.1": "libexpat1",
    "libz.so.1": "zlib1g",
    "libffi": "libffi8",
}


def remedy(message: str) -> str:
    """What to install, from a loader's error message."""
    for library, package in LIBRARIES.items():
        if library in message:
            return f"{library} is missing (Debian: apt install {package})"
    return message


def main() -> int:
    """Import every package; 2 and one line for each that does not load."""
    failed = 0
    for name in PACKAGES:
        try:
            importlib.import_module(name)
        except (ImportError, OSError) as error:
            print(f"error: {name} does not load: {remedy(str(error))}", file=sys.stderr)
            failed = 2
    return failed


if __name__ == "__main__":
    sys.exit(main())
