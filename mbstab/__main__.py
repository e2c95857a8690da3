"""``python -m mbstab``."""

from mbstab.cli import main

main(prog_name="mbstab")
