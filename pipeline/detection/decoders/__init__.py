"""Outputs of a network to candidates: one decoder per ``kind`` of ``layout.output``."""

from __future__ import annotations

from pipeline.detection.decoders.decode import decode

__all__ = ["decode"]
