"""Values that others published or derived, each with its source, beside ours.

`sources` has one file per source: citation, place, tier, and its values. Each value names a function of `quantities`
that finds ours, and how the two compare. `python -m benchmarks.corpus` checks all of them.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from benchmarks.corpus.quantities import QUANTITIES

HERE: Final = Path(__file__).parent
SOURCES: Final = HERE / "sources"
TIERS: Final = ("closed form", "independent program", "experiment", "ours")
"""Kinds of evidence, the strongest first."""

RELATIONS: Final = ("equal", "inside", "above", "below", "falls")
"""How a published value compares with ours: equal, inside our proven interval, above or below λ, or a collapse."""

CLASSES: Final = ("bond", "strength of fill", "deformation", "printed value")
"""Why a published value and ours differ: what the scene leaves out, or an error of the source."""


@dataclass(frozen=True)
class Source:
    """One publication, program or test series.

    key: name of its file. citation: authors, title, place and year. link: DOI, or repository with path; empty where
    there is none. tier: one of `TIERS`.
    """

    key: str
    citation: str
    link: str
    tier: str


@dataclass(frozen=True)
class Value:
    """One published value.

    source: where it stands. place: page, table, equation or file. what: quantity, in words. published: the value; 0
    where the relation is "falls". unit: its unit; empty for a pure number. relation: one of `RELATIONS`. tolerance:
    relative difference that digits of the source, or its discretisation, leave. find: name of a function of
    `quantities`. arguments: its arguments. spatial: True for structures in space. slow: True if ours takes more than a
    few seconds; left out of the tests. why: remark in the page; why it differs, where it does. kind: one of `CLASSES`
    where it differs, else empty. derived: True if the closed form was derived here: it counts as no value of others.
    """

    source: Source
    place: str
    what: str
    published: float
    unit: str
    relation: str
    tolerance: float
    find: str
    arguments: dict[str, Any]
    spatial: bool = False
    slow: bool = False
    why: str = ""
    kind: str = ""
    derived: bool = False

    def ours(self) -> tuple[float, float]:
        """Compute our value as an interval; both ends are equal for a single number."""
        return QUANTITIES[self.find](**self.arguments)

    def agrees(self, ours: tuple[float, float]) -> bool:
        """Return True if our interval and the published value stand in their relation."""
        low, high = ours
        slack = self.tolerance * abs(self.published)
        if self.relation == "falls":
            return low == high == 0.0
        if self.relation == "above":
            return high <= self.published + slack
        if self.relation == "below":
            return low >= self.published - slack
        if self.relation == "equal":
            return max(abs(low - self.published), abs(high - self.published)) <= slack
        return low - slack <= self.published <= high + slack


def read() -> list[Value]:
    """Read all sources, in the order of their file names.

    Raises ValueError for an unknown tier or relation, and KeyError for a missing key.
    """
    found = []
    for path in sorted(SOURCES.glob("*.toml")):
        document = tomllib.loads(path.read_text(encoding="utf-8"))
        if document["tier"] not in TIERS:
            raise ValueError(f"{path.name}: tier {document['tier']!r} is none of {TIERS}")
        for entry in document["value"]:
            tier = entry.get("tier", document["tier"])
            source = Source(path.stem, document["citation"], document.get("link", ""), tier)
            relation = entry.get("relation", "equal")
            if relation not in RELATIONS or tier not in TIERS:
                raise ValueError(f"{path.name}: {entry['what']}: unknown relation or tier")
            kind = entry.get("class", "")
            if (relation in ("above", "below") and not (kind and entry.get("why"))) or kind not in ("", *CLASSES):
                raise ValueError(f"{path.name}: {entry['what']}: a difference without its class and reason")
            found.append(
                Value(
                    source, entry.get("place", document.get("place", "")), entry["what"], float(entry["published"]),
                    entry.get("unit", ""), relation, float(entry["tolerance"]), entry["find"],
                    entry.get("arguments", {}), entry.get("spatial", False), entry.get("slow", False),
                    entry.get("why", document.get("why", "")), kind,
                    entry.get("derived", document.get("derived", False)),
                )
            )  # fmt: skip
    return found
