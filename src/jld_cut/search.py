"""Search of the fewest parts that fit and carry: anneal on all families, exact on the best, truth on convex cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from jld_core import InputError, Ints, build_assembly, parse_scene, solve_many
from jld_cut.cells import BENT, Cutting, Joint, Limits, convex_parts, joints_of
from jld_cut.families import FAMILIES, Body
from jld_cut.loads import Facet, facet_of, shares
from jld_cut.meshes import surface_of
from jld_cut.scene import Setting, grounds_of, scene_of
from jld_explore import Exploration, ExploreSettings, explore

BEST: Final = 10  # layouts that are judged on convex cells
SMALL: Final = 12  # joints up to which every layout is looked at
PIECES: Final = 150  # most convex cells


@dataclass
class Family:
    """Cells of one way to cut, and what was found on them."""

    name: str
    cutting: Cutting
    joints: list[Joint]
    document: dict[str, Any]
    found: list[Exploration] = field(default_factory=list)
    error: str = ""
    truth: Any = None  # made once

    @property
    def key(self) -> tuple[float, float, float]:
        """Order of families: one that carries first, then fewer parts, then the stronger."""
        rows = self.rows()
        if not len(rows):
            return (1.0, np.inf, 0.0)
        top = rows.iloc[0]
        return (float(not top["meets"]), float(top["blocks"]), -_strength(top))

    def rows(self) -> pd.DataFrame:
        """Return the layouts found, the best first."""
        tables = [one.results.assign(run=k) for k, one in enumerate(self.found)]
        if not tables:
            return pd.DataFrame()
        table = pd.concat(tables, ignore_index=True)
        table = table[table["status"].isin(["collapse", "locked"])]
        strength = np.where(table["status"] == "locked", np.inf, table["bracket_lo"].astype(float))
        least = self.document["search"]["require"]["load_factor"]
        table = table.assign(strength=strength, meets=strength >= least * (1 - 1e-6))
        by = ["meets", "parts_first", "strength"]
        table["parts_first"] = np.where(table["meets"], -table["blocks"], 0)
        return table.sort_values(by, ascending=False, kind="stable").drop_duplicates("labelling")


def _strength(row: Any) -> float:
    return float(row["strength"])


@dataclass(frozen=True)
class Wish:
    """What a search is asked for."""

    setting: Setting
    limits: Limits
    mass: float | None
    require: float
    most: int | None  # parts
    families: tuple[str, ...]
    seconds: float
    seed: int


def body_of(solid: Any, wish: Wish) -> Body:
    """Return a solid with what holds it and acts on it; InputError for supports or loads that meet nothing."""
    points, triangles = surface_of(solid)
    box = np.array(solid.bounding_box())
    facet = facet_of(points[triangles], float((box[3:] - box[:3]).max()))
    held = np.concatenate([ground.corners for ground in grounds_of(wish.setting, solid)])
    weight = wish.setting.matter.density * 9.81 * solid.volume() * np.array([0.0, 0.0, -1.0])
    forces, pushed = [], np.zeros(3)
    for load in wish.setting.loads:
        if load.body:
            pushed = pushed + load.vector * np.linalg.norm(weight)
        else:
            forces += [(force, at) for _, force, at in shares(load, _scattered(facet))]
    return Body(solid, held, forces, weight + pushed, wish.limits)


def _scattered(facet: Facet) -> list[Facet]:
    """Return each triangle of a surface as one of its own."""
    return [Facet(facet.corners[k : k + 1], facet.normals[k : k + 1]) for k in range(len(facet.corners))]


def family_of(name: str, title: str, body: Body, wish: Wish) -> Family | None:
    """Cut a solid in one way; None where that is no way to cut it."""
    cutting = FAMILIES[name](body)
    if cutting is None:
        return None
    cutting.halve(wish.limits)
    joints = cutting.tidy(wish.limits)
    document = scene_of(f"{title}, {name}", cutting, joints, wish.setting, BENT, cutting.planes)
    document["search"] = {
        "block_extent": [None, wish.limits.extent],
        "require": {"load_factor": wish.require},
        "front": {"count": "blocks", "sense": "min"},
        **({} if wish.mass is None else {"block_mass": [None, wish.mass]}),
        **({} if wish.most is None else {"blocks": [None, wish.most]}),
    }
    return Family(name, cutting, joints, document)


def run(family: Family, out: Path, driver: str, seconds: float, seed: int, parts: int | None = None) -> None:
    """Search one family for a time; with `parts`, the strongest of at most so many parts."""
    document = {**family.document, "search": dict(family.document["search"])}
    if parts is not None:
        del document["search"]["require"], document["search"]["front"]
        document["search"]["blocks"] = [None, parts]
    # fields and pictures of all families would take the time of the search
    settings = ExploreSettings(check_fields=0, pictures=False, seed=seed)
    try:
        family.found.append(explore(document, out, settings, driver=driver, seconds=seconds))
    except InputError as error:
        family.error = str(error)


def candidates(family: Family, most: int = BEST) -> list[tuple[Exploration, str, float]]:
    """Return the best layouts of a family with the number of parts of the first."""
    rows = family.rows()
    if not len(rows):
        return []
    rows = rows[(rows["blocks"] == rows.iloc[0]["blocks"]) & (rows["meets"] == rows.iloc[0]["meets"])].head(most)
    return [(family.found[int(row["run"])], str(row["labelling"]), _strength(row)) for _, row in rows.iterrows()]


class Truth:
    """λ of layouts of a family on convex cells, all of whose inner faces may crack."""

    def __init__(self, family: Family, setting: Setting) -> None:
        cutting = family.cutting
        pieces, self.of, planes, self.convex = convex_parts(cutting.cells, max(PIECES, 2 * len(cutting.cells)))
        fine = Cutting(cutting.solid, pieces, [*cutting.planes, *planes])
        joints = joints_of(pieces, fine.planes, fine.size, 1e-3)
        self.document = scene_of(family.document["name"], fine, joints, setting, 1e-3, fine.planes)
        self.coarse = ""  # why the cells of the search stand for convex ones
        try:
            self.assembly = build_assembly(parse_scene(self.document))
        except InputError as error:  # splinters of bisector planes may leave joints that no face bears out
            self.coarse = str(error)
            self.of, self.convex = np.arange(len(cutting.cells)), False
            self.document = {key: value for key, value in family.document.items() if key != "search"}
            self.assembly = build_assembly(parse_scene(self.document))
        self.cells = len(self.of)
        self._known: dict[bytes, tuple[float | None, float | None]] = {}

    def labels(self, block: Ints) -> Any:
        """Return labels (m,) of the pieces' faces, True = dry, for parts (n,) of the cells."""
        elements, faces = self.assembly.elements, self.assembly.interfaces
        part = np.full(len(elements), -1)
        part[: self.cells] = block[self.of]
        return part[faces.a] != part[faces.b]

    def scene(self, block: Ints) -> dict[str, Any]:
        """Return the scene of the convex cells with the parts (n,) of the cells as blocks."""
        names = [f"part {block[cell] + 1}" for cell in self.of.tolist()]
        cells = [one | {"block": name} for one, name in zip(self.document["elements"], names, strict=False)]
        return self.document | {"elements": cells + self.document["elements"][len(cells) :]}

    def solve(self, block: Ints) -> tuple[float | None, float | None]:
        """Return the bracket of a layout by the parts (n,) of the cells."""
        key = block.tobytes()
        if key not in self._known:
            found = solve_many(self.assembly, self.labels(block)[None])
            high = None if str(found.status[0]) == "locked" else _end(found.high[0])
            self._known[key] = _end(found.low[0]), high
        return self._known[key]


def _end(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def cut_ways(solid: Any, title: str, wish: Wish, say: Callable[[str], None]) -> list[Family]:
    """Cut a solid in all ways; InputError where no way is left."""
    body = body_of(solid, wish)
    families = []
    for name in wish.families:
        family = family_of(name, title, body, wish)
        cells = "no such way to cut this solid"
        if family is not None:
            families.append(family)
            cells = f"{len(family.cutting.cells)} cells, {len(family.joints)} joints"
        say(f"{name:<8} {cells}")
    if not families:
        raise InputError("jld cut", f"the solid cannot be cut by {', '.join(wish.families)}", "a further family")
    return families


def anneal(families: list[Family], out: Path, wish: Wish, seconds: float, say: Callable[[str], None]) -> None:
    """Search all families for the fewest parts that carry, and put the best first; InputError where none stands."""
    for family in families:
        driver = "anneal" if len(family.joints) > SMALL else "enumeration"
        run(family, out / family.name, driver, max(2.0, seconds / len(families)), wish.seed)
        say(f"{family.name:<8} {_told(family)}")
    families.sort(key=lambda one: one.key)
    if not len(families[0].rows()):
        reasons = "; ".join(f"{one.name}: {one.error or 'every layout falls'}" for one in families)
        raise InputError("jld cut", f"no layout was found ({reasons})", "a larger box, more time or other supports")


def prove(families: list[Family], out: Path, wish: Wish, seconds: float, say: Callable[[str], None]) -> None:
    """Search the strongest layouts of as few parts with proof, on the two best families."""
    equal = [one for one in families[:2] if one.key[:2] == families[0].key[:2]]
    parts = int(equal[0].rows().iloc[0]["blocks"])
    for family in equal:
        run(family, out / f"{family.name}-exact", "exact", max(2.0, seconds / len(equal)), wish.seed, parts)
        say(f"{family.name:<8} exact: {_told(family)}")
    families.sort(key=lambda one: one.key)


def _told(family: Family) -> str:
    rows = family.rows()
    if not len(rows):
        return family.error or "every layout falls"
    top, last = rows.iloc[0], family.found[-1].summary
    value = "no load makes it collapse" if top["status"] == "locked" else f"λ = {_strength(top):.4g}"
    return f"{last.evaluated} layouts, {int(top['blocks'])} parts, {value}{', proven' if last.proven else ''}"
