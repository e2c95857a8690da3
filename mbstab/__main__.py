"""``python -m mbstab``."""

from mbstab.cli import program

program()
