"""Every key of a scene × every door: the door says what `solve` says, or refuses in one line.

The keys are those of the schema, and a new key without its row fails. A row has two scenes that differ by its key: λ of
both must differ, and every door has to follow. Keys that one door alone reads (`OF_ONE_DOOR`) have tests of their own.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import pytest
from pydantic import BaseModel

import jld_core as jc
import jld_experiment
from cases import dry_and_inner
from command import saved
from jld_core import Result
from jld_core.models import rigid
from jld_core.scene import design
from jld_explore import ExploreSettings, explore
from jld_practice.design_check import design_check
from jld_practice.reactions import thrust_ranges
from jld_practice.reliability import ReliabilityOptions, analyse, structure_of
from jld_studio import evaluate, make_page
from jld_views import notebook

Document = dict[str, Any]

ROUNDING = 2e-5
"""Relative error within which doors agree."""


# --- scenes ---------------------------------------------------------------------------------------------------


def changed(document: Document, **values: Any) -> Document:
    """Return a scene with other values, by paths whose parts are joined by two underscores; None takes a key away."""
    made = deepcopy(document)
    for path, value in values.items():
        *before, last = path.split("__")
        place: Any = made
        for part in before:
            place = place[int(part)] if isinstance(place, list) else place.setdefault(part, {})
        if value is None:
            del place[last]
        else:
            place[int(last) if isinstance(place, list) else last] = value
    return made


def box(name: str, x0: float, y0: float, x1: float, y1: float, **more: Any) -> Document:
    return {"id": name, "polygon": [[x0, y0], [x1, y0], [x1, y1], [x0, y1]], **more}


STACK: Document = {
    "elements": [box("s", 0, 0, 4, 0.5, support=True), box("a", 1, 0.5, 2, 1.5), box("b", 1, 1.5, 2, 2.5)],
    "materials": dry_and_inner(2000.0, 0.3, 2e4, 3e4),
    "loads": {"live": [{"element": "b", "force": [1000.0, 0.0]}]},
    "search": {"candidates": [["a", "b"]], "symmetry": "none", "segmentation": False},
}
"""Two stones, the upper one pushed: it slides."""

TALL = changed(STACK, materials__dry__friction_coefficient=2.0)
"""The same, and it tilts."""

WIDE = changed(STACK, materials__dry__friction_coefficient=0.6)

CANTILEVER: Document = {
    **STACK,
    "elements": [box("s", 0, 0, 0.5, 1, support=True), box("a", 0.5, 0, 1, 1), box("b", 1, 0, 1.5, 1)],
    "loads": {"live": [{"element": "b", "force": [0.0, -1000.0]}]},
    "labels": {"inner": [["s", "a"], ["a", "b"]]},
    "materials": {**STACK["materials"], "inner": {"tensile_strength": 1e5, "shear_strength": 1e5}},
}
"""Two stones glued to a wall: the outer one bends them off."""

SHEARED = changed(
    CANTILEVER,
    materials__inner__shear_strength=1e4,
    elements__1=box("a", 0.5, 0, 0.6, 1),
    elements__2=box("b", 0.6, 0, 0.7, 1),
)
"""Shorter: they shear off."""

BEAM: Document = {
    **CANTILEVER,
    "elements": [*CANTILEVER["elements"], box("t", 1.5, 0, 2, 1, support=True)],
    "labels": {"inner": [["s", "a"], ["a", "b"], ["b", "t"]]},
}
"""The same between two walls."""

GRID: Document = {
    **{key: value for key, value in STACK.items() if key != "elements"},
    "grid": {"cell": [0.5, 0.5], "thickness": 1.0, "rows": ["a", "b", "#"]},
    "loads": {"live": [{"element": "c0r0", "force": [1000.0, 0.0]}]},
    "search": {"candidates": [["c0r0", "c0r1"]], "symmetry": "none", "segmentation": False},
}

_SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


def cuboid(name: str, low: list[float], high: list[float], **more: Any) -> Document:
    (a, b, c), (x, y, z) = low, high
    corners = [[a, b, c], [x, b, c], [x, y, c], [a, y, c], [a, b, z], [x, b, z], [x, y, z], [a, y, z]]
    return {"id": name, "vertices": corners, "faces": _SIDES, **more}


SPATIAL: Document = {
    **STACK,
    "elements": [
        cuboid("s", [0, 0, 0], [3, 3, 0.5], support=True),
        cuboid("a", [1, 1, 0.5], [2, 2, 1.5]),
        cuboid("b", [1, 1, 1.5], [2, 2, 2.5]),
    ],
    "loads": {"live": [{"element": "b", "force": [1000.0, 0.0, 0.0]}]},
}

STATED: Document = {
    **WIDE,
    "interfaces": [
        {"elements": ["s", "a"], "polygon": [[1, 0.5], [2, 0.5]]},
        {"elements": ["a", "b"], "polygon": [[1, 1.5], [2, 1.5]]},
    ],
}
STATED_INNER: Document = {
    **CANTILEVER,
    "interfaces": [
        {"elements": ["s", "a"], "polygon": [[0.5, 1], [0.5, 0]], "label": "inner"},
        {"elements": ["a", "b"], "polygon": [[1, 1], [1, 0]], "label": "inner"},
    ],
}
STATED_SHEARED: Document = {
    **SHEARED,
    "interfaces": [
        {"elements": ["s", "a"], "polygon": [[0.5, 1], [0.5, 0]], "label": "inner"},
        {"elements": ["a", "b"], "polygon": [[0.6, 1], [0.6, 0]], "label": "inner"},
    ],
}

TIE = {"kind": "tie", "from": {"element": "b", "at": [1.2, 2.4]}, "to": {"element": "s", "at": [0.2, 0.4]}}
TIED = changed(TALL, members=[{**TIE, "tension": 500.0}])
PIN = {"kind": "pin", "from": {"element": "b", "at": [1.5, 1.6]}, "to": {"element": "a", "at": [1.5, 1.4]}}
PINNED = changed(STACK, members=[{**PIN, "shear": 500.0}])

FILLED: Document = {
    **STACK,
    "elements": [box("s", 0, -1, 6, 0, support=True), box("a", 0, 0, 3, 0.6), box("b", 0, 0.6, 3, 1.2)],
    "materials": {"density": 2500.0, "dry": {"friction_coefficient": 0.6}, "inner": STACK["materials"]["inner"]},
    "fill": {"level": 2.0, "density": 1800.0, "friction_angle": 30.0},
}

OVER = {"path": [[0.6, 1], [1.4, 1]], "name": "cart", "steps": 3, "axles": [{"weight": 500.0}]}


class Row(NamedTuple):
    """Two scenes that differ by one key."""

    before: Document
    after: Document


def row(document: Document, **values: Any) -> Row:
    return Row(document, changed(document, **values))


def of(before: Document, **values: Any) -> Row:
    """A key that no scene of the row has by default: its scene with a first and with a second value."""
    first = {name: one for name, (one, _) in values.items()}
    second = {name: other for name, (_, other) in values.items()}
    return Row(changed(before, **first), changed(before, **second))


def live(before: Document, one: Document, other: Document) -> Row:
    return Row(changed(before, loads__live=[one]), changed(before, loads__live=[other]))


FACE = {"along": [[1, 1.5], [1, 2.5]]}
HALF = {"along": [[1, 1.5], [1, 2.0]]}
PATCH = {"patch": [[1, 1, 2.5], [2, 1, 2.5], [2, 2, 2.5], [1, 2, 2.5]]}
PART = {"patch": [[1.2, 1, 2.5], [2, 1, 2.5], [2, 2, 2.5], [1.2, 2, 2.5]]}


def pressed(name: str) -> Document:
    """A stack under a push and a pressure all over one of its stones."""
    return changed(STACK, loads__live=[STONE, {"face": {"between": [name, "outside"]}, "pressure": 100.0}])


STONE = {"element": "b", "force": [1000.0, 0.0]}

FILL_LOAD = {"on_fill": {"at": 1.0}, "weight": 2e3}
BESIDE_FILL = changed(FILLED, loads__live=[{"element": "b", "force": [1e4, 0]}, FILL_LOAD])

OF_A_LOAD = {
    "<PointLoad>.element": of(STACK, loads__live__0__element=("b", "a")),
    "<PointLoad>.force": of(STACK, loads__live__0__force=([1000.0, 0], [800.0, 0])),
    "<PointLoad>.at": of(changed(TALL, loads__live=[STONE]), loads__live__0__at=([1.5, 2.1], [1.5, 2.4])),
    "<PointLoad>.moment": of(changed(TALL, loads__live=[STONE]), loads__live__0__moment=(-100.0, -200.0)),
    "<BodyLoad>.body": live(STACK, {"body": [0.1, 0.0]}, {"body": [0.2, 0.0]}),
    "<FaceLoad>.face.between": Row(pressed("b"), pressed("a")),
    "<FaceLoad>.face.along": live(STACK, {"face": FACE, "pressure": 500.0}, {"face": HALF, "pressure": 500.0}),
    "<FaceLoad>.face.patch": live(
        SPATIAL, {"face": PATCH, "traction": [500.0, 0.0, 0.0]}, {"face": PART, "traction": [500.0, 0.0, 0.0]}
    ),
    "<FaceLoad>.pressure": live(STACK, {"face": FACE, "pressure": 500.0}, {"face": FACE, "pressure": [500.0, 400.0]}),
    "<FaceLoad>.line": live(STACK, {"face": FACE, "line": [500.0, 0.0]}, {"face": FACE, "line": [700.0, 0.0]}),
    "<FaceLoad>.traction": live(
        SPATIAL, {"face": PATCH, "traction": [500.0, 0.0, 0.0]}, {"face": PATCH, "traction": [600.0, 0.0, 0.0]}
    ),
    "<FillLoad>.on_fill.at": of(BESIDE_FILL, loads__live__1__on_fill__at=(1.0, 3.2)),
    "<FillLoad>.on_fill.width": of(
        changed(BESIDE_FILL, loads__live__1__on_fill__at=3.3), loads__live__1__on_fill__width=(0.2, 1.0)
    ),
    "<FillLoad>.weight": of(BESIDE_FILL, loads__live__1__weight=(2e3, 4e3)),
}
"""Keys of an entry of a live load."""


TILT = {"tilt": {"towards": [1, 0]}}
LEANING_BACK = changed(STACK, elements__2=box("b", 1, 1.5, 1.6, 2.5), materials__dry__friction_coefficient=2.0)
OF_LIVE = {"<TiltLoad>.tilt.towards": live(LEANING_BACK, TILT, {"tilt": {"towards": [-1, 0]}})}
"""Keys of an entry that is no dead load."""


def as_dead(document: Document) -> Document:
    """The same entries as dead load, a part of them, under another live load."""
    first = next(one["id"] for one in document["elements"] if one["id"] == "b")
    force = [1000.0] + [0.0] * (len(document["elements"][0].get("polygon", [[0, 0, 0]])[0]) - 1)
    return {**document, "loads": {"dead": document["loads"]["live"], "live": [{"element": first, "force": force}]}}


def in_case(document: Document) -> Document:
    """The same loads as the only one of the load cases."""
    return {**document, "loads": {"cases": [{"name": "one", **document["loads"]}]}}


CASES = changed(
    STACK, loads={"cases": [{"name": "one", "live": [STONE]}, {"name": "two", "live": [{"body": [-0.01, 0]}]}]}
)
MOVING = changed(BEAM, loads={"moving": [OVER]})
ON_CANTILEVER = changed(CANTILEVER, loads={"moving": [OVER]})
PUSHES = "loads__pushes__directions"
PUSHED = changed(STACK, loads={"pushes": {"directions": 2}})
LEANING = changed(PUSHED, elements__2=box("b", 1, 1.5, 1.6, 2.5), materials__dry__friction_coefficient=2.0)
CUT_UP = changed(CANTILEVER, cracks={"kind": "cells", "cell": 0.25})
SIDE = {"label": "inner"}
FIELDS = changed(TALL, materials__inner__compressive_strength=6e4, cracks={"kind": "fields", "gap": 0.4})

GLUE = {"tensile_strength": 1e4, "shear_strength": 3e3}
GLUED = changed(STACK, labels={"inner": [["a", "b"]]}, materials__inner=GLUE)
STATED_GLUE = changed(STATED, interfaces__1__label="inner", materials__inner=GLUE)
ONE_BLOCK = changed(STACK, elements__1__block="X", elements__2__block="X")
AXLES = [{"weight": 500.0}, {"weight": 500.0, "distance": 0.4}]
UNEVEN = changed(ON_CANTILEVER, loads__moving__0__steps=2, loads__moving__0__axles=AXLES)
UNEVEN = changed(UNEVEN, loads__moving__0__axles__0__weight=900.0, loads__moving__0__axles__1__weight=100.0)
LIFTED = changed(TIED, loads__live__0__force=[-1000.0, 0.0])
AT = {"element": "b", "at": [1.1, 1.5]}
LOW_TIE = {**TIE, "from": {"element": "b", "at": [1.2, 1.5]}}
THROUGH = changed(STACK, members=[{**TIE, "tension": 500.0, "through": [AT]}])
OVER_B = changed(TIED, members__0__from__at=[1.2, 2.4], members__0__through=[{**AT, "at": [1.1, 1.8]}])

ROWS: dict[str, Row] = {
    "grid.cell": row(GRID, grid__cell=[0.6, 0.5]),
    "grid.thickness": row(GRID, grid__thickness=0.8),
    "grid.rows": row(GRID, grid__rows=["aa", "bb", "##"]),
    "elements.polygon": row(STACK, elements__2=box("b", 1, 1.5, 2, 2.4)),
    "elements.vertices": row(SPATIAL, elements__2=cuboid("b", [1, 1, 1.5], [2, 2, 2.3])),
    "elements.weight": of(STACK, elements__2__weight=(15e3, 12e3)),
    "elements.density": of(STACK, elements__2__density=(1500.0, 1800.0)),
    "elements.volume": of(SPATIAL, elements__2__volume=(0.9, 0.8)),
    "elements.centroid": of(
        changed(SPATIAL, materials__dry__friction_coefficient=2.0),
        elements__2__centroid=([1.5, 1.5, 2.0], [1.4, 1.5, 2.0]),
    ),
    "elements.block": Row(STACK, ONE_BLOCK),
    "elements.support": row(changed(TALL, loads__live=[{"body": [0.1, 0.0]}]), elements__1__support=True),
    "thickness": of(STACK, thickness=(1.0, 0.7)),
    "tolerance": of(
        changed(
            STACK, elements=[*STACK["elements"], box("c", 2.004, 1.5, 3.004, 2.5), box("d", 2.004, 0.5, 3.004, 1.5)]
        ),
        tolerance=(0.001, 0.01),
    ),
    "interfaces.elements": Row(
        *(
            changed(
                changed(STATED, loads__live__0__force=[-1000.0, 0.0]),
                elements=[*STACK["elements"], box("t", 2, 0.5, 2.5, 3, support=True)],
                interfaces=[*STATED["interfaces"], {**SIDE, "elements": ["t", name], "polygon": [[2, y], [2, y + 1]]}],
            )
            for name, y in (("a", 0.5), ("b", 1.5))
        )
    ),
    "interfaces.polygon": row(
        changed(STATED, materials__dry__friction_coefficient=2.0), interfaces__1__polygon=[[1.0, 1.5], [1.8, 1.5]]
    ),
    "interfaces.label": of(STATED, interfaces__1__label=("dry", "inner")),
    "interfaces.friction_coefficient": of(STATED, interfaces__1__friction_coefficient=(0.3, 0.2)),
    "interfaces.friction_angle": of(STATED, interfaces__1__friction_angle=(15.0, 10.0)),
    "interfaces.tensile_strength": of(STATED_INNER, interfaces__0__tensile_strength=(1.1e5, 1.2e5)),
    "interfaces.shear_strength": of(STATED_SHEARED, interfaces__0__shear_strength=(5e3, 6e3)),
    "interfaces.compressive_strength": of(
        changed(STATED, materials__dry__friction_coefficient=2.0), interfaces__0__compressive_strength=(6e4, 8e4)
    ),
    "interfaces.cohesion": of(STATED, interfaces__1__cohesion=(100.0, 200.0)),
    "interfaces.inner_friction_coefficient": of(STATED_GLUE, interfaces__1__inner_friction_coefficient=(0.05, 0.1)),
    "interfaces.inner_friction_angle": of(STATED_GLUE, interfaces__1__inner_friction_angle=(3.0, 6.0)),
    "materials.density": row(STACK, materials__density=1800.0),
    "materials.gravity": of(STACK, materials__gravity=(9.81, [1.0, -9.0])),
    "materials.dry.friction_angle": of(
        changed(STACK, materials__dry={"cohesion": 0.0}), materials__dry__friction_angle=(15.0, 12.0)
    ),
    "materials.dry.friction_coefficient": row(STACK, materials__dry__friction_coefficient=0.25),
    "materials.dry.compressive_strength": of(TALL, materials__dry__compressive_strength=(1e5, 1.2e5)),
    "materials.dry.cohesion": of(STACK, materials__dry__cohesion=(100.0, 200.0)),
    "materials.dry.tensile_strength": of(
        changed(TALL, materials__dry__cohesion=5e3), materials__dry__tensile_strength=(500.0, 1000.0)
    ),
    "materials.inner.tensile_strength": row(CANTILEVER, materials__inner__tensile_strength=1.2e5),
    "materials.inner.shear_strength": row(
        changed(SHEARED, materials__inner__shear_strength=1e4), materials__inner__shear_strength=8e3
    ),
    "materials.inner.compressive_strength": of(CANTILEVER, materials__inner__compressive_strength=(8e4, 9e4)),
    "materials.inner.friction_angle": of(GLUED, materials__inner__friction_angle=(3.0, 6.0)),
    "materials.inner.friction_coefficient": of(GLUED, materials__inner__friction_coefficient=(0.05, 0.1)),
    "cracks<CellCracks>.kind": row(CUT_UP, cracks="faces"),
    "cracks<CellCracks>.cell": Row(CUT_UP, changed(CUT_UP, cracks__cell=0.5)),
    "cracks<FieldCracks>.kind": Row(changed(FIELDS, cracks="faces"), FIELDS),
    "loads.cases.required": Row(CASES, changed(CASES, loads__cases__0__required=2.0)),
    "loads.moving.axles.weight": row(MOVING, loads__moving__0__axles__0__weight=700.0),
    "loads.moving.axles.distance": of(
        changed(
            ON_CANTILEVER, loads__moving__0__steps=6, loads__moving__0__axles=[{"weight": 500.0}, {"weight": 400.0}]
        ),
        loads__moving__0__axles__1__distance=(0.2, 0.4),
    ),
    "loads.moving.path": row(ON_CANTILEVER, loads__moving__0__path=[[0.6, 1], [1.2, 1]]),
    "loads.moving.steps": of(changed(ON_CANTILEVER, loads__moving__0__axles=AXLES), loads__moving__0__steps=(3, 6)),
    "loads.moving.both_directions": of(UNEVEN, loads__moving__0__both_directions=(False, True)),
    "loads.moving.required": of(MOVING, loads__moving__0__required=(1.0, 2.0)),
    "loads.pushes.of_weight": of(PUSHED, loads__pushes__of_weight=(1.0, 0.5)),
    "loads.pushes.directions": of(LEANING, **{PUSHES: (1, 2)}),
    "loads.pushes.required": of(PUSHED, loads__pushes__required=(1.0, 2.0)),
    "members.kind": Row(PINNED, changed(STACK, members=[{**PIN, "kind": "tie", "tension": 500.0}])),
    "members.from.element": of(
        changed(STACK, members=[{**LOW_TIE, "tension": 500.0}]), members__0__from__element=("b", "a")
    ),
    "members.from.at": row(TIED, members__0__from__at=[1.2, 2.0]),
    "members.to.element": of(changed(TIED, members__0__to__at=[1.2, 0.5]), members__0__to__element=("s", "a")),
    "members.to.at": row(TIED, members__0__to__at=[0.8, 0.4]),
    "members.through.element": of(THROUGH, members__0__through__0__element=("a", "b")),
    "members.through.at": of(OVER_B, members__0__through__0__at=([1.1, 1.8], [1.3, 2.0])),
    "members.tension": row(TIED, members__0__tension=700.0),
    "members.compression": of(LIFTED, members__0__compression=(100.0, 300.0)),
    "members.prestress": of(changed(LIFTED, members__0__tension=500.0), members__0__prestress=(100.0, 300.0)),
    "members.shear": row(PINNED, members__0__shear=700.0),
    "fill.level": row(FILLED, fill__level=2.3),
    "fill.density": row(FILLED, fill__density=1600.0),
    "fill.friction_angle": row(FILLED, fill__friction_angle=32.0),
    "fill.cohesion": of(FILLED, fill__cohesion=(1e3, 2e3)),
    "fill.surcharge": of(FILLED, fill__surcharge=(1e3, 2e3)),
    "fill.dispersal": of(OF_A_LOAD["<FillLoad>.on_fill.at"].after, fill__dispersal=(10.0, 45.0)),
    "fill.active": of(
        changed(FILLED, loads__live__0__force=[-1e4, 0.0], elements__0=box("s", -3, -1, 6, 0, support=True)),
        fill__active=(1.0, 0.5),
    ),
    "fill.passive": of(FILLED, fill__passive=(0.4, 0.5)),
    "fill.passive_cohesion": of(changed(FILLED, fill__cohesion=5e3), fill__passive_cohesion=(0.1, 0.3)),
    "fill.from": of(FILLED, fill__from=(0.0, 1.0)),
    "fill.to": of(FILLED, fill__to=(6.0, 2.0)),
    "labels.default": of(STACK, labels__default=("dry", "inner")),
    "labels.inner": row(STACK, labels__inner=[["a", "b"]]),
    "labels.dry": row(ONE_BLOCK, labels__dry=[["a", "b"]]),
}
for ending, one in OF_LIVE.items():
    ROWS[f"loads.live{ending}"] = one
    ROWS[f"loads.cases.live{ending}"] = Row(in_case(one.before), in_case(one.after))
for ending, one in OF_A_LOAD.items():
    ROWS[f"loads.live{ending}"] = one
    ROWS[f"loads.cases.live{ending}"] = Row(in_case(one.before), in_case(one.after))
    ROWS[f"loads.dead{ending}"] = Row(as_dead(one.before), as_dead(one.after))
    ROWS[f"loads.cases.dead{ending}"] = Row(in_case(as_dead(one.before)), in_case(as_dead(one.after)))
for part in ("dry", "inner"):
    for key in (
        "friction_angle",
        "friction_coefficient",
        "compressive_strength",
        "cohesion",
        "tensile_strength",
        "shear_strength",
    ):
        if (known := ROWS.get(f"materials.{part}.{key}")) is None:
            continue
        pairs = [["a", "b"]] if "friction" in key or key == "cohesion" else [["s", "a"]]
        ROWS[f"materials.faces.{part}.{key}"] = Row(
            *(
                changed(
                    known.before
                    if part == "inner"
                    else changed(known.before, materials__dry={"friction_coefficient": 2.0}),
                    materials__faces=[{"between": pairs[0], part: one["materials"][part]}],
                )
                for one in known
            )
        )
ROWS["materials.faces.between"] = Row(
    *(
        changed(WIDE, materials__faces=[{"between": pair, "dry": {"friction_coefficient": 0.1}}])
        for pair in (["s", "a"], ["a", "b"])
    )
)


def surface(within: str, coefficient: float, tension: float, cohesion: float) -> Document:
    """The standard criterion as a yield surface."""
    bending = {"within": within, "tensile_strength": tension}
    return {"surface": {"friction": {"coefficients": coefficient, "cohesion": cohesion}, "bending": bending}}


SURFACES = {
    "dry": (STACK, [surface("edges", mu, 0.0, 0.0) for mu in (0.3, 0.2)], ["a", "b"]),
    "inner": (CANTILEVER, [surface("kern", 0.0, tension, 1e5) for tension in (9e4, 8e4)], ["s", "a"]),
}
for part, (scene, both, pair) in SURFACES.items():
    ROWS[f"materials.{part}.surface"] = of(scene, **{f"materials__{part}": tuple(both)})
    entries = tuple([{"between": pair, part: one}] for one in both)
    ROWS[f"materials.faces.{part}.surface"] = of(scene, materials__faces=entries)

NAMES = {
    "name", "units.length", "units.force", "source", "notes", "expected", "elements.id", "elements.faces",
    "loads.live<TiltLoad>.tilt.pivot", "loads.cases.live<TiltLoad>.tilt.pivot",
    "loads.cases.name", "loads.moving.name", "loads.pushes.name", "members.name",
}  # fmt: skip
"""Keys that name things, or order what other keys state."""

FIELDS_ALONE = {f"loads.{where}<PointLoad>.width" for where in ("live", "dead", "cases.live", "cases.dead")} | {
    "cracks<FieldCracks>.gap"
}
"""Keys that cracks by fields alone read."""

OF_PLUG_INS = {
    f"materials.{at}{label}.{key}"
    for at in ("", "faces.")
    for label in ("dry", "inner")
    for key in ("criterion", "parameters")
}
"""Keys of criteria of other packages: `tests/core/test_criteria.py` shows that they are obeyed."""

OF_ONE_DOOR = ("search.", "move.", "design.", "settlements.")
"""Keys of searches, of moves, of the design check and of movements of supports."""


def models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a field may hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models(part)


def keys(model: type[BaseModel] = jc.Scene, at: str = "") -> Iterator[str]:
    """Yield every key of the schema that holds a value; of several forms each with its name."""
    for name, field in model.model_fields.items():
        path = f"{at}.{field.alias or name}" if at else field.alias or name
        inner = list(models(field.annotation))
        if not inner:
            yield path
        for one in inner:
            yield from keys(one, path if len(inner) == 1 else f"{path}<{one.__name__}>")


def test_every_key_has_a_row() -> None:
    known = {*ROWS, *NAMES, *FIELDS_ALONE, *OF_PLUG_INS}
    stated = {key for key in keys() if not key.startswith(OF_ONE_DOOR)}
    assert sorted(stated - known) == []
    assert sorted(known - stated) == []


# --- doors ----------------------------------------------------------------------------------------------------


class Answer(NamedTuple):
    """What a door says: status, and bounds on λ or on the governing factor."""

    status: str
    low: float
    high: float


def answer(found: Any) -> Answer:
    """Return what a result or the JSON output of one says."""
    if isinstance(found, Result):
        return Answer(str(found.status), *found.bracket)
    ends = [math.nan if end is None else end for end in found["bracket"]]
    return Answer(found["status"], *ends)


@cache
def _solved(text: str) -> Answer:
    return answer(jc.solve(json.loads(text)))


def solved(document: Document) -> Answer:
    """Return what `solve` says, once for all doors."""
    return _solved(json.dumps(document))


def by_solve_many(document: Document, jld: Any, folder: Path) -> Answer:
    assembly = jc.build_assembly(document)
    found = jc.solve_many(assembly, [assembly.labels])
    return Answer(str(found.status[0]), found.low[0], found.high[0])


def by_command(document: Document, jld: Any, folder: Path) -> Answer:
    file = saved(folder / "scene.json", document)
    told = jld("solve", file)  # --json takes derivatives by vertices besides
    if told.code == 2:
        raise refusal(told)
    lines = {line.split("  ")[0].strip(): line.split() for line in told.out.splitlines()}
    ends = [math.nan if end == "none" else float(end) for end in lines["bracket"][1:3]]
    return Answer(lines["status"][1], *ends)


def by_search(document: Document, jld: Any, folder: Path) -> Answer:
    settings = ExploreSettings(check_fields=0, pictures=False, driver="enumeration", budget=8)
    done = explore(document, folder / "search", settings)
    letters = "".join("d" if dry else "i" for dry in done.assembly.labels[: done.assembly.faces])
    own = done.results[done.results["labelling"] == letters].iloc[0]
    return Answer(str(own["status"]), float(own["bracket_lo"]), float(own["bracket_hi"]))


def by_experiment(document: Document, jld: Any, folder: Path) -> Answer:
    """λ of what the experiment is given, which the command prints beside what it carries; no stone is moved."""

    class Given(Exception):
        pass

    def given(assembly: jc.Assembly, labels: Any, **settings: Any) -> Any:
        jld_experiment.require_one_load(assembly)
        jld_experiment.specimen_of(assembly, labels, jld_experiment.Joints(), jld_experiment.Settings())
        raise Given(assembly, labels)

    file = saved(folder / "scene.json", document)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jld_experiment, "run_experiment", given)
        try:
            raise refusal(jld("experiment", file))
        except Given as stop:
            return answer(jc.solve(*stop.args))


def by_move(document: Document, jld: Any, folder: Path) -> Answer:
    file, out = folder / "scene.json", folder / "moved.json"
    file.write_text(json.dumps({**document, "move": {"box": 1e-6}}))
    told = jld("move", file, "-o", out, "--seconds", "0", "--json")
    if told.code:
        raise refusal(told)
    found = json.loads(told.out)
    low, high = found.get("start_bracket", [found["start"]] * 2)
    return Answer("collapse", low, high)


def by_studio(document: Document, jld: Any, folder: Path) -> Answer:
    return answer(evaluate({"scene": document}))


def by_notebook(document: Document, jld: Any, folder: Path) -> Answer:
    page = make_page(jc.load_scene(document))
    found = jc.solve(document)  # a page of cells takes a label of every cell face
    letters = "".join("d" if dry else "i" for dry in found.labels[: found.assembly.faces])
    asked = {"kind": "solve", "labelling": letters, "materials": document["materials"]}
    return answer(page.answer(asked)["solution"])


def by_design_check(document: Document, jld: Any, folder: Path) -> Answer:
    """Partial factors of 1: utilisation is one over the governing factor."""
    ones = {"live": 1, "strength": 1, "friction": 1, "members": 1}
    ones |= {name: [1, 1] for name in ("self_weight", "dead", "prestressing")}
    scene = jc.load_scene({**document, "design": {"set": "none", "factors": ones}})
    worst = design_check(scene, None, design.partial_factors(scene.design, None), seconds=0.0).as_drawn
    bounds, required = worst.bounds, worst.required
    return Answer(str(bounds.status), bounds.low / required, bounds.high / required)


def fails_between(document: Document, fails: Callable[[Document, float], bool]) -> Answer:
    """Return λ as a bracket in which a door that answers yes or no changes its answer; of the answer of `solve`."""
    told = solved(document)
    low, high = told.low * (1.0 - 1e-4), told.high * (1.0 + 1e-4)
    return Answer("collapse", math.nan if fails(document, low) else low, high if fails(document, high) else math.nan)


def by_reliability(document: Document, jld: Any, folder: Path) -> Answer:
    """The density is hardly uncertain: samples fail above λ, and not below."""
    density = {"mean": document["materials"]["density"], "cov": 1e-7, "kind": "normal"}
    scene = jc.load_scene(changed(document, materials__density=density))
    assembly = jc.build_assembly(scene)
    structure = structure_of(scene, assembly, assembly.labels)

    def fails(_: Document, required: float) -> bool:
        found = analyse(structure, assembly.labels, ReliabilityOptions(required, 2, 0, 1))
        return found.simulation.failures == 2

    return fails_between(document, fails)


def by_thrust(document: Document, jld: Any, folder: Path) -> Answer:
    """Reactions exist under live load below λ, and not above."""
    assembly = jc.build_assembly(document)
    elements, labels = rigid(assembly, assembly.labels, "thrust")
    cases = list(zip(elements.by_case, assembly.required.tolist(), strict=True))

    def falls(_: Document, factor: float) -> bool:
        ranges = (thrust_ranges(one, labels, resultants=(), load_factor=factor * need) for one, need in cases)
        return any(one.stands is False for one in ranges)

    return fails_between(document, falls)


class Refused(Exception):
    """A door refused, in one line."""


def refusal(told: Any) -> Refused:
    """Return the refusal of a command; it has to be one line on stderr with exit code 2."""
    assert (told.code, told.out) == (2, ""), told
    return Refused(told.err.strip().splitlines()[-1])


DOORS: dict[str, Callable[[Document, Any, Path], Answer]] = {
    "solve_many": by_solve_many,
    "jld solve": by_command,
    "explore": by_search,
    "jld experiment": by_experiment,
    "jld move": by_move,
    "studio": by_studio,
    "notebook": by_notebook,
    "check-design": by_design_check,
    "reliability": by_reliability,
    "thrust": by_thrust,
}


def agree(one: Answer, other: Answer) -> bool:
    """Return True if two answers have one status and brackets that meet."""
    if one.status != other.status and {one.status, other.status} != {"collapse", "uncertified"}:
        return False
    if one.status in ("unstable", "locked"):
        return True
    scale = ROUNDING * max(map(abs, (one.low, one.high, other.low, other.high)))
    return one.low <= other.high + scale and other.low <= one.high + scale


@pytest.mark.parametrize("step", [4, pytest.param(1, marks=pytest.mark.long)])
def test_every_row_changes_the_answer(step: int) -> None:
    """Both scenes of a row have a λ, and it differs."""
    alike = []
    for key, (before, after) in [*ROWS.items()][::step]:
        found = solved(before), solved(after)
        if {"unstable", "locked", "failed"} & {one.status for one in found} or agree(*found):
            alike.append((key, *found))
    assert alike == []


def said(door: str, document: Document, jld: Any, folder: Path) -> Answer | str:
    """Return the answer of a door, or the line by which it refuses."""
    folder.mkdir()
    try:
        return DOORS[door](document, jld, folder)
    except (jc.InputError, Refused) as error:
        return str(error)


SAMPLED = {"solve_many": 9, "jld experiment": 18, "studio": 12, "thrust": 12, "jld solve": 18, "check-design": 72}
"""Of the scenes a door is asked one in so many; `make bench` asks all."""


def rows_for(door: str, every: bool) -> list[tuple[str, Document]]:
    """Return the scenes that a door is asked, by key; each door begins with another."""
    first, step = (0, 1) if every else ([*DOORS].index(door), SAMPLED.get(door, 32))
    rows = {json.dumps(document): (key, document) for key, row in ROWS.items() for document in row}
    return [*rows.values()][first % step :: step]


@pytest.mark.parametrize(
    ("door", "every"),
    [*((door, False) for door in DOORS), *(pytest.param(door, True, marks=pytest.mark.long) for door in DOORS)],
)
def test_a_door_says_what_solve_says(
    door: str, every: bool, jld: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notebook, "LARGEST", 0)  # no drawing
    wrong = []
    for number, (key, document) in enumerate(rows_for(door, every)):
        told = said(door, document, jld, tmp_path / str(number))
        if isinstance(told, str):
            assert "\n" not in told
        elif not agree(told, solved(document)):
            wrong.append((key, told, solved(document)))
    assert wrong == []


# --- folders, stages, results ---------------------------------------------------------------------------------


def folder_of(document: Document, folder: Path, **options: Any) -> Path:
    settings = ExploreSettings(check_fields=0, pictures=False, driver="enumeration", budget=8, **options)
    return explore(document, folder / "search", settings).folder


TWISTED = changed(SPATIAL, loads__live=[{"element": "b", "force": [1000.0, 0, 0], "at": [1.5, 1.1, 2.0]}])
LOW = changed(STACK, materials__dry__friction_coefficient={"nominal": 0.3, "low": 0.2})
OTHERS = ("thrust", "check-design", "reliability", "settlement", "assembly", "move")


@pytest.mark.parametrize(("option", "value"), [("contact", "concave"), ("effective_area", True)])
def test_a_folder_carries_its_model(option: str, value: Any, jld: Any, tmp_path: Path) -> None:
    scene = changed(TWISTED, settlements=[{"name": "down", "supports": [{"elements": ["s"], "move": [0, 0, -1]}]}])
    folder = folder_of(scene, tmp_path, model=jc.Model(**{option: value}))
    told = json.loads(jld("solve", folder, "--rank", "1", "--json").out)
    best = jc.solve(scene, told_labels(told), **{option: value})
    other = jc.solve(scene, told_labels(told))
    assert agree(answer(told), answer(best))
    assert abs(other.load_factor - best.load_factor) > 0.01 * best.load_factor
    flags = {"contact": ("--contact", "convex"), "effective_area": ()}[option]
    if flags:
        assert json.loads(jld("solve", folder, "--json", *flags).out)["load_factor"] == pytest.approx(other.load_factor)
    for door in OTHERS:
        refused = refusal(jld(door, folder, *(("-o", tmp_path / "moved.json") if door == "move" else ())))
        assert option.replace("_", " ") in str(refused)


def told_labels(told: Document) -> str:
    return "".join(face["label"][0] for face in told["faces"])


def test_a_robust_folder_stays_robust(jld: Any, tmp_path: Path) -> None:
    folder = folder_of(LOW, tmp_path, robust=True)
    told = json.loads(jld("solve", folder, "--rank", "2", "--json").out)
    assert told["load_factor"] == pytest.approx(2.0 / 3.0 * told["load_factor_nominal"])
    assert told["load_factor_nominal"] == pytest.approx(solved(STACK).low, rel=1e-6)


def test_a_folder_carries_its_crack_model(jld: Any, tmp_path: Path) -> None:
    folder = folder_of(changed(CUT_UP, cracks="faces"), tmp_path, model=jc.Model(cracks="cells:0.25"))
    told = json.loads(jld("solve", folder, "--json").out)
    assert told["cracks"] == {"kind": "cells", "cell": 0.25}
    by_faces = json.loads(jld("solve", folder, "--json", "--cracks", "faces").out)
    assert by_faces["cracks"] == "faces"
    assert abs(by_faces["load_factor"] - told["load_factor"]) > 0.1


LINTEL: Document = {
    **CANTILEVER,
    "elements": [
        box("s", 0, 0, 0.5, 0.5, support=True),
        box("a", 0, 0.5, 3, 1.0),
        box("t", 2.5, 0, 3, 0.5, support=True),
    ],
    "materials": {**STACK["materials"], "inner": {"tensile_strength": 1e4, "shear_strength": 1e5}},
    "loads": {"live": [{"element": "a", "force": [0.0, -1000.0]}]},
    "labels": {},
    "search": {},
}
"""A stone over an opening, which falls in two under its own weight: no face is drawn where it breaks."""


@pytest.mark.parametrize(("cracks", "stands"), [("faces", "yes"), ({"kind": "cells", "cell": 0.25}, "no")])
def test_stages_stand_as_the_structure_does(cracks: Any, stands: str, jld: Any, tmp_path: Path) -> None:
    file = saved(tmp_path / "scene.json", {**LINTEL, "cracks": cracks})
    assert (jc.solve(file).stands_at_zero is True) == (stands == "yes")
    jld("assembly", file, "--out", tmp_path / "out").done()
    assert f",{stands}," in (tmp_path / "out" / "assembly.csv").read_text().splitlines()[1]


def test_doors_of_rigid_elements_refuse_fields_in_one_line(jld: Any, tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    settled = {"settlements": [{"name": "down", "supports": [{"elements": ["s"], "move": [0, -1]}]}]}
    file.write_text(json.dumps({**LINTEL, **settled, "cracks": {"kind": "fields"}}))
    for door in ("assembly", "thrust", "settlement", "experiment", "report"):
        assert "cracks" in str(refusal(jld(door, file, *(["--pdf"] if door == "report" else []))))
    file.write_text(json.dumps({**CUT_UP, "labels": {}}))
    assert "cells" in str(refusal(jld("move", file, "-o", tmp_path / "moved.json")))


SLOPE: Document = {
    **STACK,
    "elements": [
        {"id": "s", "polygon": [[0, 0], [4, 0], [4, -1], [-1, -1], [-1, 4], [0, 4]], "support": True},
        {"id": "r", "polygon": [[0, 0], [4, 0], [0, 4]], "support": True},
        {"id": "b", "polygon": [[2, 2], [2.5, 2.5], [2, 3], [1.5, 2.5]]},
    ],
    "materials": {"density": 100.0, "dry": {"friction_coefficient": 0.6}},
    "loads": {"live": [{"element": "b", "force": [500.0, 0.0]}]},
    "search": {},
}
"""A block on a slope of 45 degrees: under its weight it slides down, and a push holds it."""


@pytest.mark.parametrize("cases", [False, True])
def test_least_and_greatest_load_factor(cases: bool) -> None:
    """On a slope of 45° the push over the weight is (1 ∓ μ)/(1 ± μ)."""
    weight = 100.0 * 9.81 * 0.5
    low, high = (weight / 500.0 * ratio for ratio in (0.4 / 1.6, 1.6 / 0.4))
    scene = changed(SLOPE, loads__live__0__force=[-500.0, 0.0])
    if cases:
        scene = in_case(scene)
        scene["loads"]["cases"][0]["required"] = 2.0
        low, high = low / 2.0, high / 2.0
    found = jc.solve(scene)
    assert (found.status, found.stands_at_zero) == (jc.Status.COLLAPSE, False)
    assert found.load_factor == pytest.approx(high)
    assert found.least_load_factor == pytest.approx(low, rel=1e-6)
    assert found.least_bracket[0] <= found.least_bracket[1]
    assert f"{low:.9g}" in repr(found)
    assert any("does not stand without live load" in line for line in found.warnings)
    assert found.to_json()["least_load_factor"] == pytest.approx(low)
    assert jc.solve(STACK).least_load_factor == 0.0


def test_results_are_read_alike() -> None:
    """One protocol for faces, cells and fields."""
    for cracks in ("faces", "cells:0.25", "fields:0.9"):
        found = jc.solve(CANTILEVER, cracks=cracks)
        assert found.cracks == jc.Model(cracks=cracks).cracks
        assert (found.stands_at_zero, found.least_load_factor) == (True, 0.0)
        assert found.bracket[0] <= found.load_factor <= found.bracket[1]
        assert found.to_json()["cracks"] == (cracks if cracks == "faces" else found.cracks.model_dump())
        assert cracks.split(":")[0] in repr(found)
        assert len(found.to_frame()) == found.assembly.faces == len(found.labels)
        assert found.plot() is not None
        assert "<table>" in found._repr_html_()
        assert any("faces drawn" in line for line in found.warnings) == (cracks == "faces")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"cracks": "fields", "friction": "zero-dilation"}, "friction: cracks by fields do not support it"),
        ({"cracks": "fields", "solver": "highs"}, "solver: cracks by fields do not support it"),
        ({"cracks": "cels"}, "cracks: 'cels' names no crack model"),
        ({"cracks": 3}, "cracks: 3 is wrong"),
        ({"crack": "faces"}, "crack: a model has no such field; expected `cracks`"),
        ({"gap": "small"}, "gap: 'small' is wrong"),
        ({"seconds": -1}, "seconds: -1 is no time"),
    ],
)
def test_a_model_refuses_in_one_line(options: Document, words: str) -> None:
    with pytest.raises(jc.InputError) as refused:
        jc.solve(CANTILEVER, **options)
    assert str(refused.value).startswith(words)


def test_an_assembly_remembers_its_scene() -> None:
    """Also one load case of it; what was changed since is refused."""
    scene = changed(CUT_UP, loads={"cases": [{"name": name, "live": CUT_UP["loads"]["live"]} for name in "xy"]})
    assembly = jc.build_assembly(scene)
    for one in (assembly, assembly.by_case[1], scene):
        assert agree(answer(jc.solve(one)), solved(CUT_UP))
    with pytest.raises(jc.InputError, match="was changed since it was built"):
        jc.solve(replace(assembly, dead_loads=2.0 * assembly.dead_loads))


def test_what_rigid_blocks_prove_unstable_has_its_mechanism() -> None:
    """A strong cantilever that stands loose on a support: it tilts over as one block."""
    scene = {
        **CANTILEVER,
        "elements": [box("s", 0, 0, 0.5, 1, support=True), box("a", 0, 1, 1, 2), box("b", 1, 1, 2, 2)],
        "materials": {**STACK["materials"], "inner": {"tensile_strength": 1e9, "shear_strength": 1e9}},
        "labels": {"inner": [["a", "b"]]},
        "loads": {"live": [{"element": "b", "force": [0.0, -1000.0]}]},
    }
    found = jc.solve(scene)
    assert found.status is jc.Status.UNSTABLE
    assert any("rigid" in step for step in found.solve_log)
    weight = found.assembly.dead[:, :3] + 0.0
    assert float((weight * found.instability_mechanism).sum()) > 0.0


# --- keys that one door alone reads ---------------------------------------------------------------------------

CELLS: Document = {
    "grid": {"cell": [0.5, 0.5], "thickness": 1.0, "rows": ["abcd", "efgh", "####"]},
    "materials": STACK["materials"],
    "loads": {"live": [{"element": "c0r0", "force": [1000.0, 0.0]}]},
    "search": {"candidates": [["c0r0", "c0r1"], ["c0r1", "c1r1"], ["c3r0", "c3r1"], ["c2r1", "c3r1"]]},
}
MIRROR = changed(CELLS, loads={"live": [{"body": [0.0, 1.0]}]})
CELL_MASS = 2000.0 * 0.25

SEARCHES: dict[str, tuple[Document, Any, Any]] = {
    "candidates": (CELLS, [["c0r0", "c0r1"]], [["c3r0", "c3r1"]]),
    "keep.dry": (CELLS, [], [["c0r0", "c0r1"]]),
    "keep.inner": (CELLS, [], [["c0r0", "c0r1"]]),
    "segmentation": (
        changed(CELLS, search__candidates=[["c0r0", "c1r0"], ["c0r1", "c1r1"], ["c0r0", "c0r1"], ["c1r0", "c1r1"]]),
        True,
        False,
    ),
    "block_cells": (CELLS, [1, 3], [1, 2]),
    "block_weight": (CELLS, [0, 3.1 * CELL_MASS * 9.81], [0, 2.1 * CELL_MASS * 9.81]),
    "block_extent": (CELLS, [None, 1.1], [None, 0.6]),
    "block_mass": (CELLS, [0, 3.1 * CELL_MASS], [0, 2.1 * CELL_MASS]),
    "block_aspect": (CELLS, [None, 2.1], [None, 1.1]),
    "except": (changed(CELLS, search__block_cells=[1, 1]), [], ["c0r0", "c0r1"]),
    "convex_blocks": (CELLS, False, True),
    "blocks": (CELLS, [None, None], [6, None]),
    "dry_faces": (CELLS, [None, None], [8, None]),
    "limits": (CELLS, {}, {"dry_faces": [None, 8]}),
    "shapes": (CELLS, [None, None], [None, 2]),
    "sawn_length": (CELLS, [None, None], [None, 14.0]),
    "saw_cuts": (CELLS, [None, None], [None, 26]),
    "saw_set_ups": (CELLS, [None, None], [None, 4]),
    "moulds.rotate": (CELLS, False, True),
    "moulds.flip": (CELLS, False, True),
    "require.load_factor": (CELLS, 0.5, 1.0),
    "void.cells": (changed(CELLS, search={"void": {"most": 0.3}}), ["c1r0"], ["c2r0"]),
    "void.most": (changed(CELLS, search={"void": {"cells": ["c1r0", "c2r0"]}}), 0.15, 0.3),
    "assemble": (CELLS, None, "standing"),
    "assemble_out_of_plane": (changed(CELLS, search__assemble="translation"), False, True),
    "symmetry": (MIRROR, "none", "auto"),
    "front.count": (CELLS, "dry_faces", "shapes"),
    "front.counts": (CELLS, ["dry_faces", "blocks"], ["shapes", "blocks"]),
    "front.sense": (CELLS, "max", "min"),
}
"""Keys of "search": a scene, and two values."""

SAME = {"assemble_out_of_plane", "assemble"}
"""Keys whose two values give one result here; that they are read is shown elsewhere."""


def test_every_key_of_a_search_has_a_row() -> None:
    assert sorted(f"search.{key}" for key in SEARCHES) == sorted(key for key in keys() if key.startswith("search."))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("key", SEARCHES)
def test_a_search_obeys_its_keys(key: str, tmp_path: Path) -> None:
    scene, *values = SEARCHES[key]
    found = []
    for number, value in enumerate(values):
        stated = scene if value is None else changed(scene, **{f"search__{key.replace('.', '__')}": value})
        done = explore(
            stated,
            tmp_path / str(number),
            ExploreSettings(check_fields=0, pictures=False, driver="enumeration", budget=64),
        )
        columns = ["labelling", "multiplicity", "shapes", "blocks"]
        required = done.summary.facts.get("require")
        found.append((done.results[columns].to_csv(), done.front["labelling"].tolist(), json.dumps(required)))
    assert (found[0] != found[1]) != (key in SAME)


STRONG = changed(CANTILEVER, materials__inner={"tensile_strength": 6e5, "shear_strength": 6e5})

DESIGNS: dict[str, tuple[Document, Document, Document]] = {
    "set": (STACK, {"set": "EN 1990"}, {"set": "EN 1996-1-1"}),
    "units": (STRONG, {"units": "I"}, {"units": "II"}),
    "mortar": (changed(STRONG, design__units="I"), {"mortar": "designed"}, {"mortar": "prescribed"}),
    "execution": (STRONG, {"execution": 1}, {"execution": 5}),
    "factors.self_weight": (STACK, {"factors": {"self_weight": [1.0, 1.0]}}, {"factors": {"self_weight": [0.8, 1.0]}}),
    "factors.dead": (
        changed(STACK, loads__dead=[{"element": "b", "force": [0.0, -5e3]}]),
        {"factors": {"dead": [1.0, 1.0]}},
        {"factors": {"dead": [0.8, 1.0]}},
    ),
    "factors.prestressing": (
        changed(TIED, members__0__prestress=3000.0, members__0__tension=5000.0, loads__live__0__force=[-1000.0, 0.0]),
        {"factors": {"prestressing": [1.0, 1.0]}},
        {"factors": {"prestressing": [0.8, 1.3]}},
    ),
    "factors.live": (STACK, {"factors": {"live": 1.0}}, {"factors": {"live": 1.5}}),
    "factors.strength": (STRONG, {"factors": {"strength": 1.0}}, {"factors": {"strength": 1.5}}),
    "factors.friction": (STACK, {"factors": {"friction": 1.0}}, {"factors": {"friction": 1.2}}),
    "factors.members": (TIED, {"factors": {"members": 1.0}}, {"factors": {"members": 1.2}}),
}
"""Keys of "design": a scene, and two values of "design"."""

DOWN = {"name": "down", "supports": [{"elements": ["s"], "move": [0.0, -1.0]}]}
TURNED = {"name": "turned", "supports": [{"elements": ["s"], "turn": 1.0}]}
BRIDGE = changed(LINTEL, materials__inner__tensile_strength=2e5)
SETTLEMENTS: dict[str, tuple[Document, Document]] = {
    "supports.elements": (DOWN, changed(DOWN, supports__0__elements=["t"])),
    "supports.move": (DOWN, changed(DOWN, supports__0__move=[-1.0, 0.0])),
    "supports.turn": (changed(DOWN, supports__0__turn=0.0), changed(DOWN, supports__0__turn=1.0)),
    "supports.about": (changed(TURNED, supports__0__about=[0.0, 0.0]), changed(TURNED, supports__0__about=[2.0, 0.0])),
    "load": (DOWN, changed(DOWN, load=0.5)),
}
"""Keys of "settlements": two movements of a support of `BRIDGE`, on which a stone lies across an opening."""

MOVES = {
    "vertices", "along.at", "along.direction", "along.circle", "along.supports", "ties", "inner", "straight", "angle",
    "edge", "block_mass", "draft.direction", "draft.degrees", "box", "maximise",
}  # fmt: skip
"""Keys of "move": `tests/geometry_optimisation` shows that they are obeyed."""


def test_every_key_of_one_door_has_a_row() -> None:
    known = {f"design.{key}" for key in DESIGNS} | {f"move.{key}" for key in MOVES}
    known |= {f"settlements.{key}" for key in (*SETTLEMENTS, "name")}
    assert known == {key for key in keys() if key.startswith(OF_ONE_DOOR) and not key.startswith("search.")}


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", DESIGNS)
def test_a_design_check_obeys_its_keys(key: str) -> None:
    document, *values = DESIGNS[key]
    found = []
    for value in values:
        scene = jc.load_scene({**document, "design": {**document.get("design", {}), **value}})
        found.append(
            design_check(scene, None, design.partial_factors(scene.design, None), seconds=0.0).as_drawn.bounds.low
        )
    assert abs(found[1] - found[0]) > 1e-3 * abs(found[0])


@pytest.mark.parametrize("key", SETTLEMENTS)
def test_movements_of_supports_obey_their_keys(key: str, jld: Any, tmp_path: Path) -> None:
    found = []
    for number, value in enumerate(SETTLEMENTS[key]):
        file = saved(tmp_path / f"{number}.json", {**BRIDGE, "settlements": [value]})
        told = json.loads(jld("settlement", file, "--json").out)["settlements"][0]
        found.append([told[end] and told[end]["bracket"] for end in ("least", "most")] + [told["supports"]])
    assert found[0] != found[1]


def test_fields_alone_read_widths_and_gaps() -> None:
    """A wider patch crushes less; a wider gap ends earlier."""
    load = {"element": "b", "force": [1000.0, -1000.0], "at": [1.5, 2.5]}
    narrow, wide = (changed(FIELDS, cracks__gap=0.2, loads__live=[{**load, "width": width}]) for width in (0.1, 0.8))
    one, other = jc.solve(narrow), jc.solve(wide)
    assert one.bracket[1] < other.bracket[0] or one.bracket[0] < other.bracket[0]
    assert jc.solve(narrow, cracks="fields:0.9").gap > one.gap
