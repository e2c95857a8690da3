"""CPU time of whole processes, over the imports they cannot avoid; medians of runs taken in turn."""

import resource
import statistics
import subprocess
import sys

RUNS = 7
FLOOR = [sys.executable, "-c", "import numpy, yaml, click"]
NOTHING = [sys.executable, "-c", "pass"]
COMMANDS = {
    "eig pendulum.yaml": FLOOR,
    "eig pendulum.yaml --format json": FLOOR,
    "eig top.yaml": FLOOR,
    "eig rolling_disk.yaml": FLOOR,
    "eig whipple_bicycle.yaml": FLOOR,
    "eig governor.yaml": FLOOR,
    "check four_bar.yaml": FLOOR,
    "sweep top.yaml --param omega --plot none": FLOOR,
    "--help": NOTHING,
}


def cpu(command):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main():
    print(f"{'mbstab':36} {'CPU (s)':>8} {'floor (s)':>9} {'ratio':>6} {'more (s)':>9}")
    for words, floor in COMMANDS.items():
        command = [sys.executable, "-m", "mbstab", *words.split()]
        cpu(command), cpu(floor)
        pairs = [(cpu(command), cpu(floor)) for _ in range(RUNS)]
        own, base = (statistics.median(pair[i] for pair in pairs) for i in (0, 1))
        ratio = statistics.median(a / b for a, b in pairs)
        print(f"{words:36} {own:8.3f} {base:9.3f} {ratio:6.2f} {own - base:9.3f}")


if __name__ == "__main__":
    main()
