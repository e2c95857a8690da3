"""Simple nodes of a model file: keys, names, words, texts and whole numbers; problems are recorded at their place."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

from mbstab.errors import Location, suggestion
from mbstab.model.yamlfile import Document, Mapping, Scalar, Sequence, YamlNode

Word = TypeVar("Word", bound=str)

COMMA = "a comma ends a value within braces: write 0.5 for 0,5, and quotes around a text with a comma"
"""A hint where half of a value is left, as after {value: 0,5}."""

_WHOLE, _DIGITS = re.compile(r"[-+]?[0-9]+"), re.compile(r"[0-9]")

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")


def single(node: YamlNode) -> str:
    """Return a hint if a list or a mapping stands where a single number is expected."""
    if isinstance(node, Mapping) and "value" in node.entries:
        return "units stand under parameters: declare a parameter with this value and unit there, and write its name"
    return "a single number stands without brackets" if isinstance(node, Sequence) else ""


def decimal_commas(node: Sequence, count: int) -> str:
    """Return a hint if a list has more items than the numbers due because their decimals have commas: [0,5, 1].

    A comma within a number has no blank behind it; some other comma has one, or all items are halves.
    """
    texts = [x.text if isinstance(x, Scalar) else "" for x in node.items]
    touching = [
        bool(_WHOLE.fullmatch(text) and _DIGITS.match(behind))
        and following.location == replace(here.location, column=here.location.column + len(text) + 1)
        for (text, here), (behind, following) in pairwise(zip(texts, node.items, strict=True))
    ]
    halves: list[int] = []
    for i, joined in enumerate(touching):
        if joined and (not halves or halves[-1] < i - 1):
            halves.append(i)
    if not halves or not len(texts) - len(halves) <= count < len(texts):
        return ""
    if all(touching) and len(texts) > 2 * len(halves):
        return ""
    before, behind = texts[halves[0]], texts[halves[0] + 1]
    return f"decimals have a point: {before}.{behind} for {before},{behind}"


class NodeReader:
    """Reads simple nodes of one document; after a problem, reading goes on with something harmless."""

    def __init__(self, document: Document) -> None:
        self.document = document

    def complain(self, node: YamlNode | Location, path: str, message: str, hint: str = "") -> None:
        """Record a problem at a node or a place."""
        location = node if isinstance(node, Location) else node.location
        self.document.complain(location, path, message, hint)

    def faulty(self, path: str) -> bool:
        """Whether something at a path has a problem that is told."""
        return any(x.path == path or x.path.startswith(f"{path}.") for x in self.document.problems)

    def known_keys(
        self,
        node: Mapping,
        path: str,
        known: Iterable[str],
        home: Callable[[str], str] = lambda key: "",
        others: dict[str, str] | None = None,
        instead: Callable[[str], str] = lambda key: "",
    ) -> set[str]:
        """Refuse every key that is not among the known ones; return those that are likely to be meant.

        `home` returns a hint where a key belongs that is like no known one, or an empty string; `instead` a hint that
        counts even where a known key is alike; `others` has the known keys by what they are called elsewhere.
        """
        known, meant = list(known), set[str]()
        for key, scalar in node.keys.items():
            if key not in known:
                hint = instead(key) or suggestion((others or {}).get(key, key), known) or home(key)
                hint = hint or "known keys: " + ", ".join(known)
                value = node.entries[key]
                if isinstance(value, Scalar) and value.empty:
                    # As {value: 0,5} and {description: long, thin} are read.
                    hint = COMMA
                self.complain(scalar, path, f"unknown key {key!r}", hint)
                meant.update(x for x in known if x not in node.keys and repr(x) in hint)
        return meant

    def check_name(self, key: Scalar, path: str, what: str, reserved: Iterable[str] = ()) -> bool:
        """Whether a key can be the name of something; refuse it if not."""
        if not NAME.match(key.text):
            self.complain(
                key,
                path,
                f"{key.text!r} is not a valid name for a {what}",
                "begin with a letter, and use letters, digits and _",
            )
            return False
        if key.text in reserved:
            self.complain(key, path, f"the name {key.text!r} is taken and cannot be a {what}")
            return False
        return True

    def mapping(self, node: YamlNode, path: str, expected: str = "keys with values", hint: str = "") -> Mapping | None:
        """Return a mapping; `expected` is what messages call it."""
        if not isinstance(node, Mapping):
            self.complain(node, path, f"expected {expected}", hint)
            return None
        return node

    def optional(self, node: YamlNode | None, path: str) -> Mapping | None:
        """Return a mapping that may be missing, or empty because all of it is commented out."""
        if node is None or (isinstance(node, Scalar) and node.empty):
            return None
        return self.mapping(node, path)

    def optional_pairs(self, node: YamlNode | None, path: str) -> dict[str, YamlNode]:
        """Return the entries of a mapping that may be missing or empty."""
        mapping = self.optional(node, path)
        return {} if mapping is None else mapping.entries

    def required(self, node: Mapping, key: str, path: str, hint: str = "") -> YamlNode | None:
        """Return the value of a key that must be there."""
        if key not in node.entries:
            self.complain(node, path, f"the key {key!r} is missing", hint)
            return None
        return node.entries[key]

    def text(self, node: YamlNode | None, path: str) -> str:
        """Return text on one line; it is empty if there is none."""
        if node is None:
            return ""
        if not isinstance(node, Scalar):
            self.complain(node, path, "expected text")
            return ""
        return " ".join(node.text.split())

    def word(self, node: YamlNode, path: str, what: str) -> str | None:
        """Return a scalar as it is written; `what` is what messages expect."""
        if not isinstance(node, Scalar) or node.empty:
            self.complain(node, path, f"expected {what}")
            return None
        return node.text

    def choice(self, node: YamlNode, path: str, choices: tuple[Word, ...]) -> Word | None:
        """Return one of several words."""
        word = self.word(node, path, "one of " + ", ".join(choices))
        if word is not None and word not in choices:
            hint = suggestion(word, choices) or "one of " + ", ".join(choices)
            self.complain(node, path, f"unknown choice {word!r}", hint)
        return next((choice for choice in choices if choice == word), None)

    def integer(self, node: YamlNode | None, path: str, low: int, high: int, default: int) -> int:
        """Return a whole number between two limits."""
        if node is None:
            return default
        if isinstance(node, Scalar) and re.fullmatch(r"[+-]?[0-9]{1,9}", node.text) and low <= int(node.text) <= high:
            return int(node.text)
        self.complain(node, path, f"expected a whole number between {low} and {high}")
        return default
