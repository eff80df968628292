"""Reliability, design checks and loads on outlines: units, place, turning and order of elements leave them alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from cases import box
from jld_core import build_assembly, parse_scene, solve
from jld_core.scene import design
from jld_practice.design_check import design_check
from jld_practice.reliability import ReliabilityOptions, analyse, random_structure


@dataclass(frozen=True)
class Move:
    """Where and in which units a scene is written.

    length, force: what 1 m and 1 N are. turn: (d, d) rotation. shift: of the origin, m. order: seed of the order of the
    elements; 0 as stated.
    """

    length: float = 1.0
    force: float = 1.0
    turn: np.ndarray | None = None
    shift: tuple[float, ...] = ()
    order: int = 0

    def point(self, point: Any) -> list[float]:
        moved = np.asarray(point, dtype=float)
        moved = moved if self.turn is None else self.turn @ moved
        moved = moved if not self.shift else moved + np.array(self.shift)
        return [float(x) for x in moved * self.length]

    def vector(self, vector: Any, size: float = 1.0) -> list[float]:
        turned = np.asarray(vector, dtype=float)
        turned = turned if self.turn is None else self.turn @ turned
        return [float(x) for x in turned * size]

    def elements(self, elements: list[dict[str, Any]]) -> list[dict[str, Any]]:
        order = np.arange(len(elements))
        if self.order:
            order = np.random.default_rng(self.order).permutation(len(elements))
        return [elements[k] for k in order]

    @property
    def stress(self) -> float:
        return self.force / self.length**2


def rotation(degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, -s], [s, c]])


def rotation_in_space() -> np.ndarray:
    """Rotation whose axes are parallel to no axis of the scene."""
    tilt, _ = np.linalg.qr(np.array([[1.0, 0.3, -0.2], [0.4, 1.0, 0.5], [-0.1, 0.7, 1.0]]))
    return np.asarray(tilt * np.sign(np.linalg.det(tilt)))


PLANAR = {
    "mm and kN": Move(length=1e3, force=1e-3),
    "km and µN": Move(length=1e-3, force=1e6),
    "turned and far away": Move(turn=rotation(37.3), shift=(300.0, -120.0)),
    "turned by 90°": Move(turn=rotation(90.0)),
    "reordered": Move(order=5),
}
SPATIAL = {
    "mm and kN": Move(length=1e3, force=1e-3),
    "turned and far away": Move(turn=rotation_in_space(), shift=(30.0, -12.0, 7.0)),
    "reordered": Move(order=3),
}


def wall(move: Move, **more: Any) -> dict[str, Any]:
    """Two courses on a support: a crackable stone below, pushed by a line load, a pressure and a force above."""
    boxes = {"ground": (-1, -1, 4, 0), "a": (0, 0, 1.5, 1), "b": (1.5, 0, 3, 1), "c": (0.4, 1, 2.5, 2)}
    elements: list[dict[str, Any]] = [
        {
            "id": name,
            "polygon": [move.point(p) for p in ((x0, y0), (x1, y0), (x1, y1), (x0, y1))],
            "support": name == "ground",
        }
        for name, (x0, y0, x1, y1) in boxes.items()
    ]
    stress, load = move.stress, move.force
    live = [
        {"element": "c", "force": move.vector([900.0, -200.0], load), "at": move.point([0.4, 1.7])},
        {
            "face": {"along": [move.point(p) for p in ([0.6, 2.0], [2.2, 2.0])]},
            "line": move.vector([700.0, -900.0], load / move.length),
        },
        {
            "face": {"along": [move.point(p) for p in ([0.4, 1.2], [0.4, 1.8])]},
            "pressure": [1500.0 * stress, 400.0 * stress],
        },
    ]
    return {
        "elements": move.elements(elements),
        "thickness": 0.5 * move.length,
        "materials": {
            "density": 2000.0 * load / move.length**3,
            "gravity": move.vector([0.0, -9.81]),
            "dry": {"friction_coefficient": 0.55, "cohesion": 900.0 * stress},
            "inner": {"tensile_strength": 8e3 * stress, "shear_strength": 9e3 * stress},
        },
        "labels": {"default": "dry", "inner": [["a", "b"]]},
        "loads": {"live": live, "dead": [{"element": "b", "force": move.vector([0.0, -800.0], load)}]},
        **more,
    }


def uncertain_wall(move: Move) -> dict[str, Any]:
    """The wall with uncertain density, friction, cohesion, strengths and force."""
    document = wall(move)

    def vary(mean: Any, cov: float, kind: str = "normal") -> dict[str, Any]:
        return {"mean": mean, "cov": cov, "kind": kind}

    materials, live = document["materials"], document["loads"]["live"]
    materials["density"] = vary(materials["density"], 0.05)
    materials["dry"] = {
        "friction_coefficient": vary(0.55, 0.1),
        "cohesion": vary(materials["dry"]["cohesion"], 0.2, "lognormal"),
    }
    materials["inner"]["tensile_strength"] = vary(materials["inner"]["tensile_strength"], 0.2, "lognormal")
    live[0]["force"] = vary(live[0]["force"], 0.3)
    return document


def columns(move: Move) -> dict[str, Any]:
    """Two columns on a support, pushed aside by loads on patches across both."""
    elements = [
        box("g", (-2, -2, -1), (4, 3, 0), support=True),
        box("a", (0, 0, 0), (1, 1, 2)),
        box("b", (1, 0, 0), (2, 1, 2)),
    ]
    for element in elements:
        element["vertices"] = [move.point(p) for p in element["vertices"]]
    patches = [
        (
            [[0.5, 0.2, 2], [1.8, 0.2, 2], [1.8, 0.6, 2], [0.5, 0.6, 2]],
            {"traction": move.vector([900.0, 300.0, -500.0], move.stress)},
        ),
        ([[0.0, 0.1, 1.0], [0.0, 0.1, 1.6], [0.0, 0.7, 1.6], [0.0, 0.9, 1.0]], {"pressure": 2000.0 * move.stress}),
    ]
    return {
        "elements": move.elements(elements),
        "materials": {
            "density": 2000.0 * move.force / move.length**3,
            "gravity": move.vector([0.0, 0.0, -9.81]),
            "dry": {"friction_coefficient": 0.6},
        },
        "loads": {"live": [{"face": {"patch": [move.point(p) for p in patch]}, **load} for patch, load in patches]},
    }


def under_fill(move: Move) -> dict[str, Any]:
    """The wall under fill that presses its sides, with a strip load on the surface."""
    across, up = (np.array(move.vector(axis)) @ np.array(move.shift or (0.0, 0.0)) for axis in ([1.0, 0.0], [0.0, 1.0]))
    fill = {
        "level": (3.0 + up) * move.length,
        "density": 1800.0 * move.force / move.length**3,
        "friction_angle": 30.0,
        "cohesion": 1e3 * move.stress,
        "surcharge": 2e3 * move.stress,
        "from": (0.0 + across) * move.length,
        "to": (3.0 + across) * move.length,
    }
    strip = {"at": (0.8 + across) * move.length, "width": 0.3 * move.length}
    push = {"element": "c", "force": move.vector([3e3, 0.0], move.force)}
    return wall(move, fill=fill, loads={"live": [{"on_fill": strip, "weight": 1e3 * move.force}, push]})


def load_factors(document: dict[str, Any]) -> np.ndarray:
    """Load factor of the whole scene."""
    return np.array([solve(build_assembly(parse_scene(document))).load_factor])


def uncertain_columns(move: Move) -> dict[str, Any]:
    """The columns with uncertain friction, density, and pressure on a patch."""
    document = columns(move)
    materials, live = document["materials"], document["loads"]["live"]
    materials["density"] = {"mean": materials["density"], "cov": 0.1, "kind": "lognormal"}
    materials["dry"]["friction_coefficient"] = {"mean": 0.6, "cov": 0.1, "kind": "normal"}
    live[1]["pressure"] = {"mean": live[1]["pressure"], "cov": 0.4, "kind": "lognormal"}
    return document


def indices(document: dict[str, Any]) -> np.ndarray:
    """Reliability index, importances, and the samples that fail."""
    structure = random_structure(parse_scene(document))
    found = analyse(structure, structure.assembly.labels, ReliabilityOptions(samples=2_000, required=3.0))
    return np.array([found.form.beta, *found.form.direction, found.simulation.failures, found.simulation.probability])


def utilisations(document: dict[str, Any]) -> np.ndarray:
    """Utilisation by the faces drawn under every combination, the share that joints use, and what refutes the layout.

    Bounds by fields, where blocks may crack anywhere, depend on the mesh, which no turn of a scene leaves alone.
    """
    scene = parse_scene(document)
    assert scene.design is not None
    found = design_check(scene, None, design.partial_factors(scene.design))
    assert all(one.verified for one in found.cases)
    used = 0.0 if found.reserve is None else found.reserve.share.max()
    return np.array([one.utilisation for case in found.tried for one in case] + [used, found.verified is False])


FACTORS = {
    "set": "own",
    "factors": {"self_weight": [0.9, 1.2], "dead": [0.9, 1.3], "live": 1.5, "friction": 1.25, "strength": 1.5},
}


def pushed(move: Move) -> dict[str, Any]:
    """The wall under pushes to both sides, with partial factors."""
    loads = {"dead": wall(move)["loads"]["dead"], "pushes": {"of_weight": 0.2, "directions": 2}}
    return wall(move, loads=loads, design=FACTORS)


STUDIES: dict[str, tuple[Callable[[Move], dict[str, Any]], Callable[[dict[str, Any]], np.ndarray], dict[str, Move]]] = {
    "line and pressure": (wall, load_factors, PLANAR),
    "fill": (under_fill, load_factors, PLANAR),
    "patches": (columns, load_factors, SPATIAL),
    "reliability": (uncertain_wall, indices, PLANAR),
    "reliability in space": (uncertain_columns, indices, SPATIAL),
    "design check in space": (lambda move: columns(move) | {"design": FACTORS}, utilisations, SPATIAL),
    "design check": (lambda move: wall(move, design=FACTORS), utilisations, PLANAR),
    "design check of pushes": (pushed, utilisations, PLANAR),
}


@cache
def stated(study: str) -> np.ndarray:
    """Numbers of a study of the scene as it is stated."""
    scene, numbers, _ = STUDIES[study]
    return numbers(scene(Move()))


@pytest.mark.sampled(10)
@pytest.mark.parametrize(("study", "move"), [(study, move) for study in STUDIES for move in STUDIES[study][2]])
def test_results_do_not_depend_on_how_a_scene_is_written(study: str, move: str) -> None:
    scene, numbers, moves = STUDIES[study]
    assert numbers(scene(moves[move])) == pytest.approx(stated(study), rel=1e-9, abs=1e-9)
