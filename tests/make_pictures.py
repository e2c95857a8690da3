"""Make pictures by the program itself.

``python tests/make_pictures.py`` makes those of the README again. ``python tests/make_pictures.py FOLDER`` writes the
whole gallery to a folder: the pictures of the README, each kind of picture of each example that has it, and the web
site of the manual.
"""

import argparse
import shlex
from pathlib import Path

from click.testing import CliRunner

from mbstab import load
from mbstab.cli import main
from mbstab.model.library import installed_models

FOLDER = Path(__file__).parents[1] / "mbstab" / "manual"

PICTURES = {
    "bicycle.gif": "simulate whipple_bicycle.yaml --set v=4.6 --mode-shape 1 --follow rear_body --fps 6 --view 18,-50 "
    "--animate bicycle.gif",
    "bicycle-map.png": "sweep whipple_bicycle.yaml --param v --plot map --pictures bicycle.png",
}
"""Each with the command that makes it."""

CHARTS = (
    "whipple_bicycle.yaml --param v --param g --from 0.5,1 --to 10,20 --points 41,41",
    "rolling_disk.yaml --param omega --param R --from 0,0.1 --to 8,0.6 --points 31,31",
    "ziegler_column.yaml --param P --param b_2 --from 0,0 --to 6,1 --points 41,41",
    "rotor_table.yaml --param n --param q --points 31,31",
    "von_mises_truss.yaml --param P --param h --from -10,0.5 --to 10,1.5 --points 41,41",
    "car_trailer.yaml --param u --param h --from 10,-0.5 --to 45,1 --points 31,31",
)
"""Sweeps of two parameters."""

UNBALANCES = (
    "rigid_rotor.yaml --unbalance rotor.A --speed Omega --from 1 --to 600",
    "rotor_table.yaml --unbalance rotor.A --speed n --from 1000 --to 3000",
)
"""Responses of rotors to an unbalance; their displacements are the outputs."""

OUTPUTS = "outputs: {x: rotor.x, y: rotor.y}\n"


def make(folder):
    """Write the pictures of the README to a folder."""
    for name, command in PICTURES.items():
        words = [str(folder / word) if word.startswith("bicycle") else word for word in shlex.split(command)]
        answer = CliRunner().invoke(main, words)
        assert answer.exit_code == 0, answer.output
        assert (folder / name).is_file()


def commands(path):
    """Return the commands that draw an example, without the option that says where to."""
    model, name = load(path).model, path.name
    lines = [f"eig {name} --plot spectrum,modes"]
    kinds = "map,locus,campbell" + ",path" * (model.reference.find is not None)
    lines += [f"sweep {name} --param {parameter} --plot {kinds}" for parameter in model.sweep]
    lines += [f"response {name} --plot bode,nyquist", f"response {name} --step 5"] * bool(model.inputs)
    return [*lines, f"simulate {name} --to 0.2 --once --plot energy,residuals"]


def gallery(folder):
    """Write all pictures to a folder; name the commands that have none, with their reason."""
    make(folder)
    lines = [line for path in installed_models() for line in commands(path)]
    lines += [f"sweep {line}" for line in CHARTS] + [f"response {line} --plot unbalance" for line in UNBALANCES]
    for k, line in enumerate(lines):
        name = "-".join([*line.split()[:2], str(k)]).replace(".yaml", "")
        words = shlex.split(line)
        if "--unbalance" in words:
            text = next(path for path in installed_models() if path.name == words[1]).read_text(encoding="utf-8")
            (folder / words[1]).write_text(text + OUTPUTS, encoding="utf-8")
            words[1] = str(folder / words[1])
        words += ["--quiet", "--pictures", str(folder / f"{name}.png")]
        answer = CliRunner().invoke(main, words)
        print(f"{answer.exit_code} mbstab {line}", *answer.stderr.splitlines(), sep="\n  ", flush=True)
    answer = CliRunner().invoke(main, ["manual", "--html", str(folder / "site")])
    assert answer.exit_code == 0, answer.output


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Make pictures by the program itself.")
    parser.add_argument(
        "folder", nargs="?", type=Path, help="where the whole gallery is written; else those of the README"
    )
    asked = parser.parse_args().folder
    if asked is None:
        make(FOLDER)
    else:
        asked.mkdir(parents=True, exist_ok=True)
        gallery(asked)
