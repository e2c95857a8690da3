"""Regions of a chart between the points of its grid: their sizes against those that boundaries enclose."""

import math

import numpy as np
import pytest

from mbstab.report.pictures.regions import regions


def area(polygon):
    x, y = np.array(polygon).T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def circle_on(x, y):
    """Return the points in which the unit circle crosses the lines of a grid, around it."""
    found = [(s * math.sqrt(1.0 - v * v), v) for v in y if abs(v) < 1.0 for s in (1, -1)]
    found += [(v, s * math.sqrt(1.0 - v * v)) for v in x if abs(v) < 1.0 for s in (1, -1)]
    return np.array(sorted(found, key=lambda point: math.atan2(point[1], point[0])))


@pytest.mark.parametrize("down", [False, True])
def test_regions_end_at_their_boundary(down):
    x, y = np.linspace(-1.53, 1.6, 14), np.linspace(-1.41, 1.5, 11)
    x = x[::-1] if down else x
    inside = (np.hypot(*np.meshgrid(x, y)) < 1.0).astype(int)
    found = regions(x, y, inside, [circle_on(x, y)])
    sizes = {label: sum(abs(area(polygon)) for polygon in polygons) for label, polygons in found.items()}
    assert sum(sizes.values()) == pytest.approx(abs(np.ptp(x) * np.ptp(y)), rel=1e-12)
    # Chords of the circle, of which a cell of the grid cuts off at most 3 % here; half cells are 10 % away.
    assert 0.97 * math.pi < sizes[1] < math.pi


@pytest.mark.parametrize("slope", [0.3, 2.7, -3.1])
@pytest.mark.parametrize("transposed", [False, True])
def test_regions_end_at_a_boundary_that_is_known_in_each_row_only(slope, transposed):
    """Such as that of folds: its line crosses several columns from one row to the next."""
    x, y = np.linspace(0.0, 10.0, 21), np.linspace(0.0, 3.0, 4)
    line = 5.0 - slope * (y - 1.5) + 0.013
    beyond = np.where(x < line[:, None], 0, -1)
    curve = np.column_stack([line, y])
    found = regions(y, x, beyond.T, [curve[:, ::-1]]) if transposed else regions(x, y, beyond, [curve])
    sizes = {label: sum(abs(area(polygon)) for polygon in polygons) for label, polygons in found.items()}
    assert sizes == {0: pytest.approx(3.0 * 5.013, rel=1e-12), -1: pytest.approx(3.0 * 4.987, rel=1e-12)}


def test_cells_with_three_and_four_regions_are_filled_once():
    for labels in ([[0, 1], [2, 2]], [[0, 1], [1, 0]], [[0, 1], [2, 0]], [[0, 1], [3, 2]], [[0, 1], [1, 2]]):
        found = regions(np.array([0.0, 1.0]), np.array([0.0, 2.0]), np.array(labels), [])
        assert set(found) == set(np.ravel(labels))
        assert all(area(polygon) > 0.0 for polygons in found.values() for polygon in polygons)
        assert sum(area(polygon) for polygons in found.values() for polygon in polygons) == pytest.approx(2.0)
