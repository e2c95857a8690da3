"""Writes the kernels of all elements: ``python -m mbstab.compiler.build``, and when the package is built.

A kernel is long and says nothing that its definition does not. So kernels are not kept in the repository; deriving all
of them takes some seconds, which is too long for the start of a command and little for an installation.
"""

from __future__ import annotations

import sys
from typing import Any


def write() -> None:
    """Write all kernels, and what they were made of."""
    from mbstab.compiler.emit import source
    from mbstab.compiler.kernels import FOLDER, STAMP, hash_of_sources
    from mbstab.mechanics.elements import ELEMENTS

    for path in FOLDER.glob("[a-z]*_*.py"):
        if path.stem not in ELEMENTS:
            path.unlink()
    for name in ELEMENTS:
        (FOLDER / f"{name}.py").write_text(source(name), encoding="utf-8")
    STAMP.write_text(hash_of_sources(), encoding="ascii")


def get_build_hook() -> Any:
    """Return the hook of hatchling, which loads this file by itself."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

    class Kernels(BuildHookInterface):  # type: ignore[misc]
        """Writes the kernels before the files of the wheel are collected."""

        PLUGIN_NAME = "kernels"

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            """Write the kernels into the source tree."""
            sys.path.insert(0, self.root)
            write()

    return Kernels


if __name__ == "__main__":
    write()
