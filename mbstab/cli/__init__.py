"""The command line: one small file per command; the only place that prints or exits."""

from __future__ import annotations

from mbstab.cli.main import main

__all__ = ["main"]
