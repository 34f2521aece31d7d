"""The packages of the wheel: the code, and the demo with its pools and detectors as ``searchlight_configs``."""

from pathlib import Path

from setuptools import find_packages, setup

CONFIGS = Path("configs")
folders = sorted({file.parent.relative_to(CONFIGS) for file in CONFIGS.rglob("*") if file.is_file()})
packages = {".".join(("searchlight_configs", *folder.parts)): str(CONFIGS / folder) for folder in folders}

setup(
    packages=[*find_packages(include=["pipeline*", "actors*"]), *packages],
    package_dir={"searchlight_configs": str(CONFIGS)},
    package_data={"": ["*.j2", "*.yaml", "*.jpg", "*.tif"]}
    | {"actors.view": ["static/*", "static/leaflet/*"]}
    | {name: ["*"] for name in packages},
)
