"""Commands that signals stop say so by their exit code."""

import signal

import pytest
from click.testing import CliRunner

from mbstab.analysis.simulate.run import _Leg
from mbstab.cli import main


@pytest.fixture(autouse=True)
def _handled():
    """In the background of a script interrupts are ignored, and that is inherited: here they are not."""
    before = {
        number: signal.signal(number, handler)
        for number, handler in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL))
    }
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=str)
@pytest.mark.parametrize(
    ("place", "arguments"),
    [
        ("mbstab.analysis.simulate.run._Leg.follow", ("simulate", "pendulum.yaml", "--perturb", "rod.theta=1")),
        ("mbstab.analysis.design.search._better", ("design", "car.yaml", "--vary", "a=5%", "--goal", "decay")),
        ("mbstab.api.Mechanism.eig", ("eig", "pendulum.yaml")),
    ],
    ids=str,
)
def test_exit_codes_tell_by_which_signal_a_command_was_stopped(monkeypatch, place, arguments, number):
    # Whether or not it writes what is finished.
    before = signal.getsignal(number)
    monkeypatch.setattr(place, lambda *_, **__: signal.raise_signal(number))
    assert CliRunner().invoke(main, arguments).exit_code == 128 + number
    assert signal.getsignal(number) is before


@pytest.mark.parametrize(("runs", "size"), [(1, "is not known"), (2, "as estimated")])
def test_a_motion_that_was_followed_to_its_end_did_not_end_early(monkeypatch, runs, size):
    """It is stopped while another run reduces the error."""
    follow, left = _Leg.follow, list(range(runs))
    monkeypatch.setattr(
        _Leg, "follow", lambda *x: (left.pop(), follow(*x)) if left else signal.raise_signal(signal.SIGINT)
    )
    result = CliRunner().invoke(
        main, ["simulate", "pendulum.yaml", "--perturb", "rod.theta=1", "--to", "3", "--tol", "1e-13"]
    )
    assert result.exit_code == 130
    assert "stopped before its error was reduced to the tolerance" in result.stderr
    assert size in result.stderr
    assert "ended early" not in result.output
    assert "time          0 to 3 s" in result.stdout


def test_an_ignored_signal_stays_ignored(monkeypatch):
    # So are interrupts in the background of a script.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        monkeypatch.setattr("mbstab.cli.commands.eig.load_model", lambda *_: signal.raise_signal(signal.SIGINT))
        result = CliRunner().invoke(main, ["eig", "pendulum.yaml"])
        assert isinstance(result.exception, AttributeError)
    finally:
        signal.signal(signal.SIGINT, before)
