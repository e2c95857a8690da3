"""Margins in Bode diagrams."""

import numpy as np
import pytest

import mbstab
from mbstab.report.pictures.responses import response_picture
from mbstab.report.responses import decibels


@pytest.mark.parametrize("name", ["dc_motor_arm", "levitation", "whipple_bicycle", "wheeled_inverted_pendulum"])
def test_bode_diagrams_show_the_margins_that_are_printed(name):
    """Each as a step from the response itself, at its frequency, to 0 dB or to an odd multiple of 180 degrees."""
    result = mbstab.load(f"{name}.yaml").response()
    figure = response_picture(result, "")
    count = 0
    for axes, of_gain in zip(figure.axes, (True, False), strict=True):
        steps = [line for line in axes.get_lines() if line.get_marker() == "o"]
        inside = [
            (k, x)
            for k, own in enumerate(result.margins)
            for x in (own.gain if of_gain else own.phase)
            if result.x[0] <= x.frequency <= result.x[-1]
        ]
        assert len(steps) == len(inside)
        texts = " ".join(text.get_text() for text in axes.texts)
        for step, (k, margin) in zip(steps, inside, strict=True):
            (omega, _), (start, end) = step.get_data()
            value = result.exact.over(np.array([omega]))[0][result.exact.number(result.channels[k])][0]
            assert omega == margin.frequency
            assert start == pytest.approx(decibels(value) if of_gain else start, abs=1e-6)
            assert end % 360.0 == pytest.approx(0.0 if of_gain else 180.0)
            if not of_gain:
                assert (start - np.degrees(np.angle(value)) + 90.0) % 360.0 == pytest.approx(90.0, abs=1e-6)
            size = decibels(margin.factor) if of_gain else margin.phase
            assert f"{size:.3g}".replace("-", "\N{MINUS SIGN}") in texts
            assert axes.get_ylim()[0] <= min(start, end) <= max(start, end) <= axes.get_ylim()[1]
            count += 1
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert ("gain and phase margins" in legend) == (count > 0)
    assert count >= 1
