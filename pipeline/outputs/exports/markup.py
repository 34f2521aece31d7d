"""XML that is always well formed: every text from outside is text, never markup."""

from __future__ import annotations

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from pipeline.outputs.exports.words import clean


def add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """A new element below parent; its text is escaped when it is written."""
    element = SubElement(parent, tag, {name: clean(value) for name, value in attributes.items()})
    if text is not None:
        element.text = clean(text)
    return element


def xml_bytes(root: Element) -> bytes:
    """The document in UTF-8, indented."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"
