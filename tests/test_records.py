"""Records behave like dataclasses, and share their methods."""

import copy
import dataclasses
import pickle
from dataclasses import FrozenInstanceError, field, replace

import pytest

from mbstab.records import dataclass


@dataclass(frozen=True)
class Place:
    x: int
    tags: list = field(default_factory=list)
    kept: dict = field(default_factory=dict, init=False, compare=False, repr=False)


@dataclass(frozen=True)
class Named(Place):
    name: str = "?"


@dataclass
class Open:
    x: int = 1

    def __post_init__(self):
        self.doubled = 2 * self.x


def test_values_by_place_by_name_and_by_default():
    assert Place(1) == Place(x=1) == Place(1, []) != Place(1, [2])
    assert Place(1).tags is not Place(1).tags
    assert repr(Named(1, name="a")) == "Named(x=1, tags=[], name='a')"
    assert Named(1) != Place(1)
    assert Open(3).doubled == 6


@pytest.mark.parametrize(
    ("values", "named", "why"),
    [((), {}, "needs x"), ((1, [], 3), {}, "takes"), ((1,), {"x": 2}, "at most once"), ((1,), {"kept": {}}, "takes")],
)
def test_wrong_values_are_refused(values, named, why):
    with pytest.raises(TypeError, match=why):
        Place(*values, **named)


def test_frozen_ones_do_not_change():
    place = Place(1)
    for change in (lambda: setattr(place, "x", 2), lambda: setattr(place, "z", 2), lambda: delattr(place, "x")):
        with pytest.raises(FrozenInstanceError):
            change()
    with pytest.raises(TypeError, match="unhashable"):
        hash(Open())
    assert hash(Place(1, ())) == hash(Place(1, ()))


def test_the_tools_of_dataclasses_know_them():
    place = Named(1, [2], "a")
    place.kept["seen"] = True
    assert replace(place, x=3) == Named(3, [2], "a")
    assert replace(place, x=3).kept == {}
    assert dataclasses.asdict(Named(1)) == {"x": 1, "tags": [], "kept": {}, "name": "?"}
    assert pickle.loads(pickle.dumps(place)) == copy.deepcopy(place) == place
    assert pickle.loads(pickle.dumps(place)).kept == {"seen": True}
    match place:
        case Named(x, [tag], name):
            assert (x, tag, name) == (1, 2, "a")


def test_methods_are_not_compiled_for_each_class():
    for name in ("__init__", "__repr__", "__eq__", "__hash__", "__setattr__"):
        assert getattr(Place, name).__code__ is getattr(Named, name).__code__, name
