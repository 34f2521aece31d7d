"""HTML pages that stand alone: templates that escape all text, pictures inside the page."""

from __future__ import annotations

import base64

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


def page_environment(package: str) -> Environment:
    """Templates of a package; unknown names fail, every text from outside is escaped. Filter: png."""
    environment = Environment(
        loader=PackageLoader(package, "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["png"] = png_uri
    return environment


def png_uri(picture: bytes) -> Markup:
    """A PNG file as the address of an image."""
    return Markup("data:image/png;base64,{}").format(base64.b64encode(picture).decode("ascii"))
