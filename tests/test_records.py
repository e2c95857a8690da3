"""Records behave like dataclasses, and share their methods."""

import copy
import dataclasses
import pickle
from dataclasses import FrozenInstanceError, field, replace
from typing import ClassVar

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
    kind: ClassVar[str] = "open"
    x: int = 1

    def __post_init__(self):
        self.doubled = 2 * self.x


def test_values_by_place_by_name_and_by_default():
    assert Place(1) == Place(x=1) == Place(1, []) != Place(1, [2])
    assert Place(1).tags is not Place(1).tags
    assert repr(Named(1, name="a")) == "Named(x=1, tags=[], name='a')"
    assert Named(1) != Place(1)
    assert Open(3).doubled == 6


@pytest.mark.table
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
    assert len({Place(1, ()), Named(1, ())}) == len({repr(Place(1)), repr(Named(1))}) == 2
    assert Place(1) == Place(1)
    assert Named(1) == Named(1)
    for name in ("__init__", "__repr__", "__eq__", "__hash__", "__setattr__"):
        assert getattr(Place, name).__code__ is getattr(Named, name).__code__, name


def test_what_is_never_asked_for_is_never_made():
    @dataclass(frozen=True)
    class Unused:
        x: int
        tags: list = field(default_factory=list)
        size: float = field(default=2.0, compare=False)

    assert Unused.size == 2.0
    assert not hasattr(Unused, "tags")
    assert Unused(1).tags == []
    assert not isinstance(vars(Unused)["__dataclass_fields__"], dict)
    assert dataclasses.is_dataclass(Unused)
    assert Unused(1) == Unused(1, size=3.0)
    assert [(f.name, f.type, f.compare) for f in dataclasses.fields(Unused)] == [
        ("x", int, True),
        ("tags", list, True),
        ("size", float, False),
    ]
    assert Unused.size == 2.0
    assert Unused.__match_args__ == ("x", "tags", "size")


def test_a_field_that_a_subclass_assigns_keeps_its_place():
    @dataclass(frozen=True)
    class Tagged(Place):
        y: int = 3
        tags: list = field(default_factory=lambda: [0])

    assert repr(Tagged(1)) == "test_a_field_that_a_subclass_assigns_keeps_its_place.<locals>.Tagged(x=1, tags=[0], y=3)"
    assert Tagged(1, [2], 4) == Tagged(y=4, tags=[2], x=1)
    assert Open.kind == "open"
    assert [f.name for f in dataclasses.fields(Open)] == ["x"]
