"""Search of the fewest parts that fit and carry: all layouts of all families, and λ of the best on convex cells."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from jld_core import (
    Assembly,
    Bits,
    Deadline,
    DeadlinePassed,
    Floats,
    InputError,
    Ints,
    Layout,
    build_assembly,
    parse_scene,
    plugins,
)
from jld_core.limit import face_jumps
from jld_cut.cells import BENT, SPLIT, Cutting, Joint, Limits, convex_parts, joints_of, without_splinters
from jld_cut.clock import SEARCHED, Clock
from jld_cut.families import FAMILIES, Body
from jld_cut.meshes import moments, surface_of
from jld_cut.partitions import BEST, Bounds, Boxes, SearchGoal, SearchResult, frames, labels_of, search
from jld_cut.scene import Facet, Region, Setting, facet_of, grounds_of, scene_of, shares
from jld_explore import Driver, Exploration, ExploreSettings, SearchSpace, explore, search_space
from jld_explore.evaluation import Pool

Bracket = tuple[float | None, float | None, bool]  # bounds on λ, and whether no load makes a layout collapse

PIECES: Final = 150  # most convex cells
MOST: Final = 24  # parts, where no other number is asked for
_BESIDE: Final = 8.0  # time of a search from which families are searched beside each other, s
_CUT: Final = 0.6  # share of the time of the search up to which solids are cut finer
_WITHOUT: Final = 0.4  # the same by which a search goes on that found nothing that carries
_OFF: Final = 0.01  # distance of a section from mean planes of facets that bear it, by size
_FINER: Final = 1.7  # cells of the second cutting of each family by those of the first


@dataclass
class Family:
    """Cells of one way to cut, and what was found on them."""

    name: str
    cutting: Cutting
    joints: list[Joint]
    document: dict[str, Any]
    together: list[int]  # sets of cells that no joint may part
    found: SearchResult = field(default_factory=SearchResult)
    fine: Any = None  # its `FineModel`, made once

    @property
    def around(self) -> list[int]:
        """Return the set of cells that each cell has a joint with."""
        index_of = {element["id"]: k for k, element in enumerate(self.document["elements"])}
        neighbours = [0] * len(self.cutting.cells)
        for interface in self.document["interfaces"]:
            a, b = (index_of[name] for name in interface["elements"])
            if max(a, b) < len(neighbours):
                neighbours[a] |= 1 << b
                neighbours[b] |= 1 << a
        return neighbours

    @property
    def normals(self) -> Floats:
        normals = np.array([plane[:3] for plane in self.cutting.planes]).reshape(-1, 3)
        return normals[[k for k, n in enumerate(normals) if not (np.abs(normals[:k] @ n) > 1 - 1e-6).any()]]

    def layout(self, block: Ints) -> Layout:
        """Return the layout of the parts (n,) of its cells."""
        scene = parse_scene(self.document)
        assembly = build_assembly(scene)
        return Layout(scene, assembly, labels_of(assembly, block[None])[0])

    def boxes(self) -> Boxes:
        """Return the boxes of the cells in all frames in which a part may lie."""
        cells = self.cutting.cells
        corners = [surface_of(cell.hull())[0] for cell in cells]
        return Boxes.of(corners, np.array([moments(cell) for cell in cells]), frames(self.normals))


@dataclass(frozen=True)
class Wish:
    """What the parts of a solid must fit and carry, in m and kg."""

    setting: Setting  # material, supports and loads
    limits: Limits
    mass: float | None  # largest mass of a part
    require: float  # load factor
    most: int | None  # parts
    families: tuple[str, ...]  # names of ways to cut
    seconds: float  # time for all
    whole: tuple[Region, ...] = ()  # that no joint meets
    alike: int | None = None  # most different shapes of parts


def body_of(solid: Any, wish: Wish) -> Body:
    """Return a solid with what holds it and acts on it; InputError for supports or loads that meet nothing."""
    points, triangles = surface_of(solid)
    box = np.array(solid.bounding_box())
    facet = facet_of(points[triangles], float((box[3:] - box[:3]).max()))
    held_corners = np.concatenate([ground.corners for ground in grounds_of(wish.setting, solid)])
    weight = wish.setting.matter.density * 9.81 * solid.volume() * np.array([0.0, 0.0, -1.0])
    forces, pushed = [], np.zeros(3)
    facets = [Facet(facet.corners[k : k + 1], facet.normals[k : k + 1]) for k in range(len(facet.corners))]
    for load in wish.setting.loads:
        if load.body:
            pushed = pushed + load.vector * np.linalg.norm(weight)
        else:
            forces += [(force, at) for _, force, at in shares(load, facets)]
    return Body(solid, held_corners, forces, weight + pushed, wish.limits)


def family_of(name: str, title: str, body: Body, wish: Wish) -> Family | None:
    """Cut a solid in one way; None where that is no way to cut it."""
    cutting = FAMILIES[name](body)
    if cutting is None:
        return None
    cutting.halve(body.limits)
    joints = cutting.tidy(body.limits)
    document = scene_of(f"{title}, {name}", cutting, joints, wish.setting, BENT, cutting.planes)
    uncut = [joint for joint in joints for region in wish.whole if _meets(joint, region)]
    return Family(name, cutting, joints, document, [1 << joint.a | 1 << joint.b for joint in uncut])


def _meets(joint: Joint, region: Region) -> bool:
    ring = joint.polygon
    triangles = np.array([ring[[0, k, k + 1]] for k in range(1, len(ring) - 1)])
    return bool(region.clipped(triangles)[0].sum() > 0.0)


class FineModel:
    """λ of layouts of a family on convex cells, all of whose inner faces may crack."""

    def __init__(self, family: Family, setting: Setting, *, few: bool = False) -> None:
        cutting, self.coarse = family.cutting, ""  # why the cells of the search stand for convex ones
        pieces, of, planes, self.convex = convex_parts(cutting.cells, max(PIECES, 2 * len(cutting.cells)))
        fine = Cutting(cutting.solid, pieces, [*cutting.planes, *planes])
        joints = joints_of(pieces, fine.planes, fine.size, SPLIT)
        if (without := without_splinters(pieces, of, joints)) is not None:
            fine.cells, of = without
            joints = joints_of(fine.cells, fine.planes, fine.size, SPLIT)
        document = scene_of(family.document["name"], fine, joints, setting, SPLIT, fine.planes)
        # nearly plane facets are one face to a scene, and exact sections of them lie off it
        for variant in (document, document | {"tolerance": _OFF * fine.size}):
            try:
                self._bounds = Bounds(variant, crush=True, few=few)
            except InputError as error:
                self.coarse = str(error)
            else:
                self.document, self.of, self.coarse = variant, of, ""
                break
        else:
            self.document, self.of, self.convex = family.document, np.arange(len(cutting.cells)), False
            self._bounds = Bounds(self.document, crush=True, few=few)
        self.cells = len(self.of)
        self.known: dict[bytes, Bracket] = {}
        self._orders: dict[bytes, Any] = {}

    def scene(self, block: Ints) -> dict[str, Any]:
        """Return the scene of the convex cells with the parts (n,) of the cells as blocks."""
        names = [f"part {block[cell] + 1}" for cell in self.of.tolist()]
        cells = [element | {"block": name} for element, name in zip(self.document["elements"], names, strict=False)]
        return self.document | {"elements": cells + self.document["elements"][len(cells) :]}

    def order(self, block: Ints, seconds: float) -> Any:
        """Return the order of assembly of a layout by translations; False for none, None where time ends before."""
        # pieces that are convex pass each other as they are, others as their hulls
        key, assembly = block.tobytes(), self._bounds.assembly
        if self._orders.get(key) is None:
            labels, bodies = labels_of(assembly, block[self.of][None])[0], self._laying.bodies
            try:
                with Deadline(seconds).enforced():
                    order = plugins.part("order_without_stages")(assembly, labels, bodies=bodies)
                    self._orders[key] = order or False
            except DeadlinePassed:
                return None
        return self._orders[key]

    @cached_property
    def _laying(self) -> Any:
        # what moves past what is known to all layouts
        assembly = self._bounds.assembly
        may_join = np.ones(len(assembly.interfaces), dtype=bool)
        return plugins.part("laying_constraint")(assembly, "translation", may_join)

    def locking(self, block: Ints, seconds: float) -> list[int]:
        """Return cells of parts that lock one another, as few as are found in time."""
        labels = labels_of(self._bounds.assembly, block[self.of][None])[0]
        try:
            with Deadline(seconds).enforced():
                lock = self._laying.lock(labels)
        except DeadlinePassed:
            return list(range(len(block)))
        return [] if lock is None else np.unique(self.of[np.asarray(lock.elements)]).tolist()

    def jumps(self, block: Ints) -> tuple[Assembly, Floats | None]:
        """Return the assembly of a layout and the jumps (m, 6) of its mechanism, None without one."""
        analysis, assembly = self._bounds.analysis, self._bounds.assembly
        labels = labels_of(assembly, block[self.of][None])[0]
        if analysis.batch is None:
            mechanism = analysis.solve(labels).mechanism
            return assembly, None if mechanism is None else face_jumps(assembly, mechanism)
        # the other solvers take minutes where this one proves no upper bound
        velocity = analysis.batch.solve(labels[None], vectors=True).velocities[0]
        return assembly, analysis.prover.motion(velocity, labels, normalise=False).jumps

    def solve(self, block: Ints) -> Bracket:
        """Return the bracket of a layout by the parts (n,) of the cells."""
        key = block.tobytes()
        if key not in self.known:
            low, high, locked = (values[0] for values in self._bounds(block[self.of][None]))
            self.known[key] = finite(low), finite(high), bool(locked)
        return self.known[key]


def low_of(bracket: Bracket) -> float:
    """Return the lower end of a bracket, infinite where no load makes a layout collapse."""
    return np.inf if bracket[2] else -np.inf if bracket[0] is None else bracket[0]


def weaker(bracket: Bracket, coarse: float) -> Bracket:
    """Return a bracket that is not above λ of the cells of the search: a verdict rests on the weaker of both."""
    # Smaller faces bear more torsion together than one of their size, so finer cells may seem stronger.
    return (coarse, bracket[1], False) if -np.inf < coarse < low_of(bracket) else bracket


def finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _cuttings(solid: Any, title: str, wish: Wish, say: Callable[[str], None], clock: Clock) -> Iterator[Family]:
    """Cut a solid in all ways, then again to finer cells while time lasts."""
    body = body_of(solid, wish)
    finer = replace(body.limits, aim=min(body.limits.cells, round(_FINER * body.limits.aim)))
    made_before: set[tuple[str, int]] = set()
    for limits in (body.limits, finer):
        for name in wish.families:
            if limits is finer and name not in {name_made for name_made, _ in made_before}:
                continue
            make = partial(family_of, name, title, replace(body, limits=limits), wish)
            stage = f"{name} of {limits.aim} cells"
            # one family at least
            family = clock.run(stage, SEARCHED * (_CUT if limits is finer else 1.0), make) if made_before else make()
            if family is None:
                say(f"{name:<8} " + ("time ended" if stage in clock.left_out else "no such way to cut this solid"))
            elif (name, len(family.cutting.cells)) not in made_before:
                made_before.add((name, len(family.cutting.cells)))
                yield family


def search_all(solid: Any, title: str, wish: Wish, clock: Clock, say: Callable[[str], None]) -> list[Family]:
    """Search all families, two at a time, until their time ends; InputError where no layout stands."""
    families: list[Family] = []
    futures: list[Callable[[], SearchResult]] = []
    messages: list[str] = []  # printed only beside a layout
    start, until = time.time(), clock.at(SEARCHED)
    # processes take seconds to start
    jobs = 2 if until - start > _BESIDE and (os.cpu_count() or 1) > 1 else 1
    with Pool(jobs) as pool:
        for family in _cuttings(solid, title, wish, messages.append, clock):
            # two at a time, each round with its share of the time; what is left is for finer cells
            rounds = -(-len(wish.families) // jobs)
            end = start + (until - start) * min(1.0, (len(families) // jobs + 1) / rounds)
            last = end + _WITHOUT * (until - start)
            task = (
                family.document,
                family.boxes(),
                family.around,
                wish.limits,
                family.together,
                SearchGoal(wish.require, wish.most or MOST, end, last, wish.alike),
            )
            families.append(family)
            futures.append(pool.submit(search, *task).result if jobs > 1 else partial(search, *task))
            if jobs == 1:
                family.found = futures[-1]()
        for family, result in zip(families, futures, strict=True):
            family.found = result() if jobs > 1 else family.found
            messages.append(f"{family.name:<8} {len(family.cutting.cells)} cells: {told(family, wish.require)}")
    if not families:
        raise InputError("jld cut", f"the solid cannot be cut by {', '.join(wish.families)}", "a further family")
    if not any(len(layouts.low) for family in families for layouts in family.found.of.values()):
        reasons = "; ".join(f"{family.name}: {told(family, wish.require)}" for family in families)
        raise InputError(
            "jld cut", f"no layout was found ({reasons})", "a larger box, more parts, more time or other supports"
        )
    for line in messages:
        say(line)
    return families


def told(family: Family, require: float) -> str:
    """Return in words what was found on the cells of a family."""
    outcome = family.found
    solved, branches = (
        sum(getattr(layouts, name) for layouts in outcome.of.values()) for name in ("solved", "branches")
    )
    best = next(
        (n for n, layouts in sorted(outcome.of.items()) if len(layouts.low) and layouts.low[0] >= require), None
    )
    best = best or max((n for n, layouts in outcome.of.items() if len(layouts.low)), default=None)
    if best is None:
        within = "no layout within the limits on parts and shapes stands" if branches else "no parts fit the box"
        fits = "every layout falls" if solved else within
        return f"{outcome.problem or fits}, {solved} layouts and {branches} branches"
    value = (
        f"λ = {outcome.of[best].low[0]:.4g}" if np.isfinite(outcome.of[best].low[0]) else "no load makes it collapse"
    )
    bound = outcome.bound(best)
    proof = ", proven" if outcome.proven(best) else f", bound {bound:.4g}" if np.isfinite(bound) else ""
    return f"{solved} layouts and {branches} branches, {best} parts, {value}{proof}"


class ListDriver(Driver):
    name = "listed"

    def __init__(self, space: SearchSpace, rows: Bits) -> None:
        super().__init__(space)
        self._rows = rows

    def ask(self, limit: int | None = None) -> Bits:
        labellings, self._rows = self._rows[:limit], self._rows[len(self._rows[:limit]) :]
        return labellings

    def tell(self, labellings: Bits, evaluations: Any) -> None: ...


def explore_best(family: Family, block: Ints, out: Path, seconds: float) -> Exploration:
    """Return the best layouts of a family as a search, with its tables and records in a folder."""
    scene = parse_scene(family.document | {"search": {"front": {"count": "blocks", "sense": "min"}}})
    assembly = build_assembly(scene)
    rows = np.concatenate(
        [block[None], *(layouts.blocks[:BEST] for layouts in family.found.of.values() if len(layouts.low))]
    )
    labels, first = np.unique(labels_of(assembly, rows), axis=0, return_index=True)
    driver = ListDriver(search_space(scene, assembly), labels[np.argsort(first)])
    return explore(scene, out, ExploreSettings(check_fields=0, pictures=False), driver=driver, seconds=seconds)
