"""Values that others published or derived, each with its source, beside ours.

`sources` has one file per source: citation, place, tier, and its values. Each value names a function here
that finds ours, and how the two compare. `python -m benchmarks.corpus` checks all of them.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from studies.families import semicircular_arch
from studies.published_wall import layout
from studies.scenes import ring_arch, stacked_cubes

from benchmarks.common import ROOT
from benchmarks.scenes import stones
from jld_core import Assembly, LimitAnalysis, Scene, build_assembly, load_scene, parse_scene, solve
from jld_core.fields import bounds_by_fields
from jld_core.geometry.outlines import rectangle_torsion_length
from jld_practice.reactions import reactions_of_supports, resultant_of_joint, thrust_ranges
from jld_practice.reactions.thrust import ForceFunction, Resultant
from jld_samples import box

Interval = tuple[float, float]
HERE: Final = Path(__file__).parent


def _scene(name: str) -> Scene:
    own = HERE / "scenes" / f"{name}.json"
    return load_scene(own if own.exists() else ROOT / "scenes" / f"{name}.json")


def _solved(scene: Scene | dict[str, Any], **options: Any) -> Interval:
    parsed = scene if isinstance(scene, Scene) else parse_scene(scene)
    return (solve(build_assembly(parsed), **options).load_factor,) * 2


def load_factor(scene: str) -> Interval:
    """λ of a scene under its own labels."""
    return _solved(_scene(scene))


def tilt_angle(scene: str) -> Interval:
    low, high = solve(build_assembly(_scene(scene))).facts["tilt_bracket"]
    return low, high


def published_wall(layout_name: str) -> Interval:
    """λ of one of the layouts of the study of that name."""
    return (layout(layout_name).load_factor,) * 2


def stands(scene: str) -> Interval:
    """(1, 1) if a scene stands under its dead load, (0, 0) if it falls, (0, 1) if that is undecided."""
    assembly = build_assembly(_scene(scene))
    found = LimitAnalysis(assembly).stands(assembly.labels)
    return (0.0, 1.0) if found is None else (float(found),) * 2


def _range(assembly: Assembly, resultant: Resultant, load: float = 0.0) -> Interval:
    """Return both ends of a resultant's proven interval; infinite where unbounded."""
    (found,) = thrust_ranges(assembly, resultants=[resultant], load_factor=load).ranges
    low, high = found.interval
    return -math.inf if low is None else low, math.inf if high is None else high


def joint_force(scene: str, joint: list[str], component: str = "N", over: float = 1.0) -> Interval:
    """Proven interval of a resultant across a joint under the dead load, over a unit."""
    assembly = build_assembly(_scene(scene))
    (wanted,) = (one for one in resultant_of_joint(assembly, *joint) if one.component == component)
    low, high = _range(assembly, wanted)
    return low / over, high / over


def reaction(scene: str, supports: list[str], component: str) -> Interval:
    """Proven interval of one component of the sum of some supports' reactions under the dead load."""
    return _reaction(_scene(scene), supports, component)


def _reaction(scene: Scene, supports: list[str], component: str) -> Interval:
    assembly = build_assembly(scene)
    wanted = [one for one in reactions_of_supports(assembly, supports) if one.component == component]
    total = ForceFunction(np.sum([one.function.weights for one in wanted], axis=0), wanted[0].function.unit)
    return _range(assembly, Resultant("supports", component, wanted[0].point, total))


def _bisect(stands_at: Callable[[float], bool | None], low: float, high: float, width: float) -> float:
    """Return the least value at which something stands, to a width."""
    while high - low > width:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stands_at(middle) else (middle, high)
    return high


def _stands(scene: Scene) -> bool | None:
    assembly = build_assembly(scene)
    return LimitAnalysis(assembly).stands(assembly.labels)


def least_thickness(count: int, friction: float, width: float = 1e-7) -> Interval:
    """Least t/R of a semicircular arch with its weight along the centreline."""
    return (_bisect(lambda t: _stands(semicircular_arch(count, t, friction)), 0.05, 0.3, width),) * 2


def least_thickness_of_ring(pieces: int, cuts: str = "radial") -> Interval:
    """Least t/R of a semicircular arch under the true weight of its ring."""
    return (_bisect(lambda t: _stands(ring_arch(pieces, t, 2.0, cuts)), 0.05, 0.2, 1e-6),) * 2


def least_friction(count: int, thickness: float) -> Interval:
    """Least friction coefficient at which a semicircular arch stands."""
    return (_bisect(lambda mu: _stands(semicircular_arch(count, thickness, mu)), 0.1, 1.0, 1e-6),) * 2


def crown_thrust(count: int, thickness: float) -> Interval:
    """Horizontal thrust of a semicircular arch over weight per unit of angle, R = 1, under its own weight."""
    scene = semicircular_arch(count, thickness, 0.9)
    assembly = build_assembly(scene)
    bearing = [name for name, support in zip(assembly.elements.ids, assembly.elements.support, strict=True) if support]
    found = _reaction(scene, bearing[:1], "Fx")
    low, high = sorted(abs(one) / (assembly.total_dead / math.pi) for one in found)
    return low, high


def cubes(count: int, bending: Any = "uncoupled", degrees: float | None = None, **joint: Any) -> Interval:
    """λ of unit cubes on one another under a horizontal body load. joint: tension, shear, friction, base."""
    direction = None if degrees is None else math.radians(degrees)
    scene = stacked_cubes(count, direction=direction, **{"friction": 0.7, **joint})
    return _solved(scene, inner_bending=bending)


def column(blocks: int, friction: float) -> Interval:
    """λ of a column of unit cubes in the plane under a horizontal body load."""
    materials = {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": friction}}
    cells = {"cell": [1.0, 1.0], "rows": ["ab"[k % 2] for k in range(blocks)] + ["#"]}
    return _solved({"grid": cells, "materials": materials, "loads": {"live": [{"body": [1, 0]}]}})


def _prism(sides: Sequence[float], friction: float, live: dict[str, Any], gravity: Any = 1.0) -> Interval:
    """λ of a prism of weight 1 (scaled by gravity) on a support, in space."""
    a, b, h = sides
    elements = [
        box("ground", (-2 * a, -2 * b, -1.0), (2 * a, 2 * b, 0.0), support=True),
        box("prism", (-a / 2, -b / 2, 0.0), (a / 2, b / 2, h), density=1.0 / (a * b * h)),
    ]
    return _solved(stones(elements, [live], friction, gravity=gravity, density=1.0))


def rocking_prism(sides: list[float], friction: float, degrees: float) -> Interval:
    """λ of a prism under a horizontal body load in some direction."""
    return _prism(sides, friction, {"body": [math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0]})


def twisted_prism(sides: list[float], friction: float) -> Interval:
    """λ of a prism of weight 1 under a unit moment about its vertical axis."""
    return _prism(sides, friction, {"element": "prism", "moment": [0, 0, 1]})


def block_on_slope(degrees: float, friction: float) -> Interval:
    """λ of a flat block on a slope pushed down the slope by a body load along it."""
    tilt = math.radians(degrees)
    return _prism((1.0, 1.0, 0.1), friction, {"body": [1, 0, 0]}, [math.sin(tilt), 0.0, -math.cos(tilt)])


def keystone(degrees: float, friction: float, end: str) -> Interval:
    """Least or greatest thrust of a keystone of weight 1 whose faces lean by an angle from the vertical."""
    t = math.tan(math.radians(degrees))
    outlines = {
        "left": [[-3, 0], [-1, 0], [-1 - t, 1], [-3, 1]],
        "key": [[-1, 0], [1, 0], [1 + t, 1], [-1 - t, 1]],
        "right": [[1, 0], [3, 0], [3, 1], [1 + t, 1]],
    }
    elements = [{"id": k, "polygon": outline, "weight": 1.0, "support": k != "key"} for k, outline in outlines.items()]
    scene = parse_scene(stones(elements, [{"element": "key", "force": [0, -1]}], friction))
    low, high = _reaction(scene, ["left"], "Fx")
    return (low, low) if end == "least" else (high, high)


def pushed_wall(height: float, thickness: float, moved: float = 0.0) -> Interval:
    """Force at mid-height over weight that a wall cracked at its base and mid-height resists, its top held by a strut.

    moved: displacement of mid-height over the thickness. Beyond 0 the halves stand on the edges that they rock about,
    drawn as faces of 1/10 000 of the thickness; weights act at the centroids of the turned halves.
    """
    half, t = 0.5 * height, thickness
    sin = moved * t / half
    cos = math.sqrt(1.0 - sin * sin)
    width = 1e-4 * t if moved else t
    x, y = t - t * cos + half * sin, half * cos + t * sin  # Mid-height edge, after a turn about the edge of the base.
    top = [x + 0.5 * t * cos - half * sin, y + half * cos + 0.5 * t * sin]
    outlines = {
        "ground": [[-t, -t], [2 * t, -t], [2 * t, 0], [-t, 0]],
        "lower": [[t - width, 0], [t, 0], [x + width, y], [x, y]],
        "upper": [[x, y], [x + width, y], [top[0] + t / 2, top[1]], [top[0] - t / 2, top[1]]],
        "prop": [[-9 * t, top[1]], [-8 * t, top[1]], [-8 * t, top[1] + t], [-9 * t, top[1] + t]],
    }
    centroids = {
        "lower": [t - 0.5 * t * cos + 0.5 * half * sin, 0.5 * half * cos + 0.5 * t * sin],
        "upper": [x + 0.5 * t * cos - 0.5 * half * sin, y + 0.5 * half * cos + 0.5 * t * sin],
    }
    strut = {"from": {"element": "prop", "at": [-8 * t, top[1]]}, "to": {"element": "upper", "at": top}}
    elements = [
        {"id": name, "polygon": outline, "weight": 0.0, "support": name in ("ground", "prop")}
        for name, outline in outlines.items()
    ]
    document = stones(elements, [{"element": "upper", "force": [1, 0], "at": [x, y]}], 5.0)
    document["members"] = [{"kind": "tie", **strut, "tension": 9.0}]
    document["loads"]["dead"] = [{"element": k, "force": [0, -0.5], "at": point} for k, point in centroids.items()]
    return _solved(document)


def torsion_length(a: float, b: float) -> Interval:
    return (float(rectangle_torsion_length(np.array([a]), np.array([b]))[0]),) * 2


def bounds(scene: str, gap: float, **options: Any) -> Interval:
    """Bracket of λ by fields."""
    found = bounds_by_fields(build_assembly(_scene(scene)), gap=gap, **options)
    return found.lower, found.upper


QUANTITIES: Final[dict[str, Callable[..., Interval]]] = {  # functions by the name that sources use
    one.__name__: one for one in (
        block_on_slope, bounds, column, crown_thrust, cubes, joint_force, keystone, least_friction,
        least_thickness, least_thickness_of_ring, load_factor, published_wall, pushed_wall, reaction,
        rocking_prism, stands, tilt_angle, torsion_length, twisted_prism
    )
}  # fmt: skip


SOURCES: Final = HERE / "sources"
TIERS: Final = ("closed form", "independent program", "experiment", "ours")  # kinds of evidence, the strongest first
# how a published value compares with ours: equal, inside our proven interval, above or below λ, or a collapse
RELATIONS: Final = ("equal", "inside", "above", "below", "falls")
# why a published value and ours differ: what the scene leaves out, or an error of the source
CLASSES: Final = ("bond", "strength of fill", "deformation", "printed value")


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
    relative difference that digits of the source, or its discretisation, leave. find: name of a
    function here. arguments: its arguments. spatial: True for structures in space. slow: True if ours takes more than a
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
