"""Define the data format of a page, from which `page_schema` and `tools/page_contract.py` make the page's checks."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import ConfigDict, Field, TypeAdapter, with_config
from typing_extensions import TypeAliasType, TypedDict

FORMAT: Final = "jld-page"  # identifier of the data format
VERSION: Final = 1  # version of the data format

# Objects have all of their keys and no others
_EXACT: Final = ConfigDict(extra="forbid", use_attribute_docstrings=True)
Point = TypeAliasType("Point", Annotated[list[float], Field(min_length=2, max_length=3)])
Bracket = Annotated[list[float | None], Field(min_length=2, max_length=2)]
Pair = Annotated[list[int], Field(min_length=2, max_length=2)]
Base64 = Annotated[str, Field(json_schema_extra={"contentEncoding": "base64"})]


@with_config(_EXACT)
class Units(TypedDict):
    """Names of the units of the scene."""

    length: str
    force: str


Edge = TypedDict("Edge", {"element": int, "from": Point, "to": Point})  # "from" cannot name an attribute.
Edge.__pydantic_config__ = _EXACT  # type: ignore[attr-defined]


@with_config(_EXACT)
class Fact(TypedDict):
    """A fact of the scene or the search, shown by name."""

    name: str
    value: str


@with_config(_EXACT)
class Element(TypedDict):
    """Element of the assembly: name, shape and weight."""

    id: str
    support: bool
    shape: Annotated[list[Point], Field(min_length=3)]
    """Planar: the outline, counter-clockwise; spatial: the vertices."""
    faces: list[Annotated[list[int], Field(min_length=3)]]
    """Spatial: vertex numbers of each face, outward; planar: empty."""
    centroid: Point
    weight: float
    """Magnitude of its self-weight."""


@with_config(_EXACT)
class Face(TypedDict):
    """Interface of two elements of the assembly."""

    elements: Pair
    """Numbers of its two elements; the normal runs from the first to the second."""
    polygon: Annotated[list[Point], Field(min_length=2)]
    origin: Point
    normal: Point
    area: float
    """Planar: length times thickness."""
    candidate: bool
    """True if a search may choose its label."""


@with_config(_EXACT)
class Structure(TypedDict):
    """Elements and faces of the scene, in the order of the assembly."""

    dimension: Literal[2, 3]
    units: Units
    size: float
    """Largest side of the bounding box."""
    typical: float
    """Median size of a free element: the yardstick of marks."""
    elements: list[Element]
    faces: list[Face]
    edges: list[Edge]
    """Planar: pieces of outline that touch no other element."""
    resultants: list[str]
    """Names of the numbers in a row of forces."""
    touching: list[Pair]
    """Pairs of supports that share a face: they are of one block."""
    members: list[Member]
    """Ties, tendons, pins and pressures of fill."""
    fill: list[list[Point]]
    """Planar: outlines of fill above the elements."""


@with_config(_EXACT)
class Member(TypedDict):
    """Tie, tendon, pin or pressure of fill: a line through points of elements."""

    name: str
    kind: Literal["tie", "tendon", "pin", "fill"]
    elements: Annotated[list[int], Field(min_length=2)]
    """Number of the element of each point."""
    points: Annotated[list[Point], Field(min_length=2)]


@with_config(_EXACT)
class Load(TypedDict):
    """Live load as a page draws it: force, force on all bodies, or couple."""

    case: str
    kind: Literal["live", "body", "couple"]
    element: str
    """Name of the element, or the empty string."""
    at: Point
    """Tip of the arrow, or middle of the couple."""
    vector: Annotated[list[float], Field(min_length=1, max_length=3)]
    """Force, or (for a couple) its moment."""


@with_config(_EXACT)
class CaseSolution(TypedDict):
    """Solution of one layout under one load case; null where unknown."""

    name: str
    """Name of the case; the empty string in a scene with a single load."""
    required: float
    """Required load factor, by which λ is divided."""
    load_factor: float | None
    bracket: Bracket
    gap: float | None
    status: str
    friction: str
    forces: list[list[float]] | None
    """One row for each face."""
    utilisation: list[float] | None
    """0 … 1 for each face."""
    pressure: list[Point] | None
    """Centre of pressure of each face."""
    on_face: list[bool] | None
    """True if that centre lies on the face."""
    vectors: list[Point] | None
    """Force of each face, with the sign that runs down the load path."""
    members: list[float] | None
    """Tension of each member, of a pin its shear."""
    thrust: list[Annotated[list[Point], Field(min_length=2)]]
    """Pieces of the thrust line."""
    mechanism: list[list[float]] | None
    """Velocities of each element about its centroid."""
    scale: float
    """Factor on the velocities for a picture."""
    movements: list[str] | None
    """What each face does in the mechanism."""
    places: list[Point] | None
    """Where it does that, at rest."""


@with_config(_EXACT)
class Solution(TypedDict):
    """Solution of one layout: λ, bracket, status, and a solution for each load case."""

    labelling: Annotated[str, Field(pattern="^[div]*$")]
    """Letters d, i and v (beside a cell that is left out), one for each face."""
    load_factor: float | None
    """Load factor λ; with several load cases the least λ over what is required."""
    bracket: Bracket
    status: str
    governing: int
    """Number of the case that governs."""
    cases: Annotated[list[CaseSolution], Field(min_length=1)]


@with_config(_EXACT)
class Column(TypedDict):
    """Column of the table of layouts, with one value per row; null where not computed."""

    name: str
    """Name as in results.csv."""
    title: str
    unit: str
    kind: Literal["number", "integer", "text"]
    values: list[float | str | None]


@with_config(_EXACT)
class Table(TypedDict):
    """Table of layouts that the page shows, by columns, with the labels of each row as bits."""

    rows: int
    columns: list[Column]
    labellings: Base64
    """Base64 of the bits of all labellings, a whole number of bytes a row, 1 = dry."""
    beside: Base64
    """Base64 of bits like those of labellings, 1 = the face is beside a cell that is left out; "" where none is."""
    evidence: list[Literal["proven", "found", "visited"]]
    """Evidence of each row."""
    count: str
    """Name of the column that the picture weighs against λ."""
    sense: Literal["max", "min"]
    """Better direction of the count."""
    line: bool
    """True if the front is a line in that picture, because it weighs λ against one count."""
    counts: list[str]
    """Names of the columns that the picture may have across."""
    left_out: int
    """Rows of the results that the page does not hold."""


@with_config(_EXACT)
class Mark(TypedDict):
    """Marker of the drawings: shape, colours #rrggbb, and legend text."""

    shape: Literal["circle", "diamond", "thin diamond", "triangle", "cross"]
    fill: str
    edge: str
    meaning: str


@with_config(_EXACT)
class Look(TypedDict):
    """Colours, dashes and marks by which the page draws, the same as in figures of matplotlib."""

    tints: Annotated[list[str], Field(min_length=1)]
    plain: str
    support: str
    hatch: str
    ink: str
    soft: str
    rest: str
    load: str
    press: str
    member: str
    used: Annotated[list[str], Field(min_length=2)]
    thrust: str
    thrust_dash: list[float]
    inner_dash: list[float]
    movements: dict[str, Mark]
    yielding: dict[str, Mark]
    evidence: dict[str, Mark]
    front: str
    small: float
    """Share of the largest force below which an arrow is left out."""
    yields: float
    """Utilisation from which a face is marked."""
    eye: Annotated[list[float], Field(min_length=2, max_length=2)]
    """Azimuth and elevation of spatial views, degrees."""


@with_config(_EXACT)
class Curve(TypedDict):
    """Best load factor of a search against solves and time: lists with one entry per point."""

    name: str
    solves: list[int]
    seconds: list[float]
    best: list[float]


@with_config(_EXACT)
class Picture(TypedDict):
    """Picture drawn by Python, which the page itself cannot draw."""

    title: str
    png: Base64
    """Base64 of a PNG file."""


@with_config(_EXACT)
class Notebook(TypedDict):
    """Additional data of a page in a notebook: materials with which the kernel solves again."""

    materials: dict[str, Any]
    """Materials of the scene, which the sliders begin with."""
    why: str
    """Why the sliders do nothing without a kernel."""
    fixed: bool
    """True if the sliders do nothing with a kernel either."""


@with_config(_EXACT)
class PageData(TypedDict):
    """All data of a page, for a report of a search, a single scene or the studio."""

    format: Literal["jld-page"]
    version: Literal[1]
    kind: Literal["report", "studio"]
    title: str
    facts: list[Fact]
    warnings: list[str]
    how: str
    """Sentence on how to get the forces of a layout that the page holds none of; {rank} stands for its rank."""
    look: Look
    structure: Structure
    cases: Annotated[list[str], Field(min_length=1)]
    """Names of the load cases; one empty name in a scene with a single load."""
    loads: list[Load]
    table: Table | None
    solutions: dict[str, Solution]
    """Solutions by number of the row."""
    convergence: list[Curve]
    pictures: list[Picture]
    """Pictures of what the page itself cannot draw: stress and velocity fields."""
    scene: dict[str, Any]
    """The scene file."""
    summary: dict[str, Any]
    """Content of summary.json, or empty."""
    studio: dict[str, Any] | None
    """Data that only the studio has."""
    notebook: Notebook | None
    """Data that only a page in a notebook has."""


def page_schema() -> dict[str, Any]:
    """Return the JSON schema, draft 2020-12, of the data of a page."""
    schema = TypeAdapter(PageData).json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
