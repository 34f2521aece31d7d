"""QGIS's styles (QML) of the layers of a GeoPackage: one symbol, and the name beside it."""

from __future__ import annotations


def point_style(rgb: str) -> str:
    """A circle with its name. rgb: RRGGBB."""
    return _style(
        "marker",
        "SimpleMarker",
        {"name": "circle", "color": _rgba(rgb), "outline_color": "255,255,255,255", "size": "4"},
        named=True,
    )


def line_style(rgb: str) -> str:
    """A line of 0.6 mm."""
    return _style("line", "SimpleLine", {"line_color": _rgba(rgb), "line_width": "0.6"}, named=False)


def fill_style(rgb: str, alpha: int) -> str:
    """An outline, filled with its colour. alpha: 0 to 255."""
    options = {"color": _rgba(rgb, alpha), "outline_color": _rgba(rgb), "outline_width": "0.5"}
    return _style("fill", "SimpleFill", options, named=False)


def _style(kind: str, symbol: str, options: dict[str, str], *, named: bool) -> str:
    said = "".join(
        f'<Option name="{name}" value="{value}" type="QString"/>' for name, value in options.items()
    )
    props = "".join(f'<prop k="{name}" v="{value}"/>' for name, value in options.items())
    label = (
        '<labeling type="simple"><settings><text-style fieldName="name" fontSize="9"/></settings></labeling>'
        if named
        else ""
    )
    return (
        '<!DOCTYPE qgis PUBLIC "http://mrcc.com/qgis.dtd" "SYSTEM"><qgis version="3.22">'
        '<renderer-v2 type="singleSymbol"><symbols>'
        f'<symbol type="{kind}" name="0" alpha="1"><layer class="{symbol}" enabled="1">'
        f'<Option type="Map">{said}</Option>{props}</layer></symbol></symbols></renderer-v2>{label}</qgis>'
    )


def _rgba(rgb: str, alpha: int = 255) -> str:
    return ",".join(str(int(rgb[k : k + 2], 16)) for k in (0, 2, 4)) + f",{alpha}"
