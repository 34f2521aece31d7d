"""The report for the incident file as PDF (A4): verdict, places by probability, map, pictures, limits.

By ReportLab (BSD, plain Python, 9 MB): typst's binding would set nicer type, and brings a compiler of 60 MB with it.
The type is DejaVu Sans, which matplotlib carries: it knows the letters of most places' and people's names.
"""

from __future__ import annotations

import io
from html import escape
from pathlib import Path
from typing import Any

import matplotlib
from PIL import Image as PillowImage
from reportlab.lib import colors
from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.units import mm
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import Image, KeepTogether, Paragraph, SimpleDocTemplate, Spacer, Table, TableStyle

from pipeline.outputs.exports.view import Place, RunView
from pipeline.outputs.exports.words import clean, local_time, said_of, what_to_do
from pipeline.storage.whole_or_nothing import write_bytes

_FONT, _BOLD = "DejaVuSans", "DejaVuSans-Bold"
_MARGIN = 16 * mm
_WIDTH = A4[0] - 2 * _MARGIN


def write_pdf(folder: Path, view: RunView) -> list[str]:
    """Write ``report.pdf``; the same view gives the same bytes."""
    for name in (_FONT, _BOLD):
        pdfmetrics.registerFont(TTFont(name, Path(matplotlib.get_data_path()) / f"fonts/ttf/{name}.ttf"))
    pdfmetrics.registerFontFamily(_FONT, normal=_FONT, bold=_BOLD, italic=_FONT, boldItalic=_BOLD)
    buffer = io.BytesIO()
    document = SimpleDocTemplate(
        buffer,
        pagesize=A4,
        leftMargin=_MARGIN,
        rightMargin=_MARGIN,
        topMargin=_MARGIN,
        bottomMargin=_MARGIN,
        title=clean(view.mission),
        author="Searchlight",
        invariant=1,
    )
    document.build(_story(view), onFirstPage=_foot(view), onLaterPages=_foot(view))
    write_bytes(folder / "report.pdf", buffer.getvalue())
    return ["report.pdf"]


def _story(view: RunView) -> list[Any]:
    made = view.made_at.strftime("%Y-%m-%d %H:%M:%SZ")
    story: list[Any] = [
        _text("Searchlight – report of a search", 8, color=colors.grey),
        _text(view.mission, 18, bold=True),
        _text(view.verdict, 12, bold=True),
        _text(f"Made {made}. Positions are WGS84.", 8, color=colors.grey),
    ]
    if view.redacted:
        story.append(_text(view.redacted, 9, bold=True))
    for title, places in (
        ("Places, the most probable first", view.found),
        ("Possible places", view.possible),
    ):
        if places:
            story += [_text(title, 13, bold=True), _table(places, view)]
    if view.map_png is not None:
        picture = _picture(view.map_png.read_bytes(), _WIDTH, 160 * mm)
        story.append(KeepTogether([_text("Map", 13, bold=True), picture]))
    if any(place.pictures for place in view.places):
        story.append(_text("What the cameras saw", 13, bold=True))
    story += [_details(place, view) for place in view.places]
    limits = [*view.limits, *view.absent]
    if limits:
        story.append(_text("What limits this map", 13, bold=True))
        story += [_text(f"• {limit}", 9) for limit in limits]
    return story


def _table(places: tuple[Place, ...], view: RunView) -> Table:
    head = ("No.", "Probability", "What to do", "MGRS", "Latitude, longitude", "Seen")
    rows = [[_text(title, 8, bold=True) for title in head]]
    for place in places:
        error = "" if place.error is None else f" ± {place.error.semi_major_m:.1f} m"
        cells = (
            str(place.id),
            f"{place.probability:.0%}",
            what_to_do(place),
            f"{place.mgrs}{error}",
            place.position,
            local_time(place.first_seen, place.clock, view),
        )
        rows.append([_text(cell, 8) for cell in cells])
    widths = [w * _WIDTH for w in (0.06, 0.12, 0.28, 0.2, 0.18, 0.16)]
    table = Table(rows, colWidths=widths, repeatRows=1)
    table.setStyle(
        TableStyle(
            [
                ("VALIGN", (0, 0), (-1, -1), "TOP"),
                ("LINEBELOW", (0, 0), (-1, -1), 0.4, colors.lightgrey),
                ("LEFTPADDING", (0, 0), (-1, -1), 3),
                ("RIGHTPADDING", (0, 0), (-1, -1), 3),
            ]
        )
    )
    return table


def _details(place: Place, view: RunView) -> Any:
    said = [_text(place.name, 10, bold=True)]
    # what redaction left out is said once, at the head
    said += [_text(f"{label}: {text}", 8) for label, text in said_of(place, view) if text != view.redacted]
    pictures = [_picture(picture.png, 38 * mm, 38 * mm) for picture in place.pictures[:3]]
    times = [_text(local_time(p.time, place.clock, view), 7, color=colors.grey) for p in place.pictures[:3]]
    beside = [part for pair in zip(pictures, times, strict=True) for part in pair]
    table = Table([[said, beside]], colWidths=[0.74 * _WIDTH, 0.26 * _WIDTH])
    table.setStyle(TableStyle([("VALIGN", (0, 0), (-1, -1), "TOP"), ("LEFTPADDING", (0, 0), (-1, -1), 0)]))
    return KeepTogether([table, Spacer(1, 2 * mm)])


def _picture(png: bytes, most_wide: float, most_high: float) -> Image:
    with PillowImage.open(io.BytesIO(png)) as picture:
        width, height = picture.size
    shrink = min(most_wide / width, most_high / height)
    return Image(io.BytesIO(png), width * shrink, height * shrink)


def _text(text: str, size: float, *, bold: bool = False, color: Any = colors.black) -> Paragraph:
    # a paragraph reads markup: what comes from outside is escaped
    style = ParagraphStyle(
        "text",
        fontName=_BOLD if bold else _FONT,
        fontSize=size,
        leading=1.3 * size,
        spaceBefore=0.5 * size,
        spaceAfter=0.15 * size,
        textColor=color,
        # a title stays with what it is the title of
        keepWithNext=bold and size >= 13,
    )
    return Paragraph(escape(clean(text)), style)


def _foot(view: RunView) -> Any:
    def draw(canvas: Any, document: Any) -> None:
        canvas.setFont(_FONT, 7)
        canvas.setFillColor(colors.grey)
        canvas.drawString(_MARGIN, 9 * mm, clean(view.mission)[:90])
        canvas.drawRightString(A4[0] - _MARGIN, 9 * mm, f"page {document.page}")

    return draw
