"""The command line: one file per command in `mbstab.cli.commands`; the only place that prints or exits."""

from __future__ import annotations

from mbstab.cli.main import main, program

__all__ = ["main", "program"]
