"""Make the pictures of the README by the program itself: ``python tests/make_pictures.py [FOLDER]``."""

import shlex
import sys
from pathlib import Path

from click.testing import CliRunner

from mbstab.cli import main

FOLDER = Path(__file__).parents[1] / "mbstab" / "manual"

PICTURES = {
    "bicycle.gif": "simulate whipple_bicycle.yaml --set v=4.6 --mode-shape 1 --follow rear_body --fps 6 --view 18,-50 "
    "--animate bicycle.gif",
    "bicycle-map.png": "sweep whipple_bicycle.yaml --param v --plot map --pictures bicycle.png",
}
"""Each with the command that makes it."""


def make(folder):
    """Write the pictures to a folder."""
    for name, command in PICTURES.items():
        words = [str(folder / word) if word.startswith("bicycle") else word for word in shlex.split(command)]
        answer = CliRunner().invoke(main, words)
        assert answer.exit_code == 0, answer.output
        assert (folder / name).is_file()


if __name__ == "__main__":
    make(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
