"""Scene data that another file format cannot represent, stored in the file for re-import; and what is not kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core import InputError, Layout, Scene, plugins
from jld_core.build import build_geometry
from jld_core.build import loads as build_loads
from jld_core.scene import loads as scene_loads
from jld_core.scene import uncertain
from jld_formats.formats import formats
from jld_formats.options import rounded

# Scene keys that a file of all elements represents by its geometry
_DRAWN: Final = {"elements", "grid", "interfaces", "labels"}

# Element keys that a file represents by its geometry; all others are stored
_SHAPE: Final = {"id", "polygon", "vertices", "faces", "support"}

STORED: Final = frozenset(  # scene keys that a file of an earlier export may hold and that are read back
    {field.alias or name for name, field in Scene.model_fields.items()} - (_DRAWN - {"elements", "interfaces"})
)

# Parts of a yield surface that say the same in the plane and in space; Hoek–Brown, if it is at one point
_ALIKE: Final = ("friction", "bending", "hoek_brown", "reference_strength")

# Keys of an interface that are written anew; all others are values that override the materials
_PLACE: Final = {"elements", "polygon", "label"}


def document_of(layout: Layout) -> dict[str, Any]:
    """Return the scene of a layout as a JSON document: keys without default values, and means."""
    document: dict[str, Any] = uncertain.with_means(layout.scene.model_dump(mode="json", exclude_defaults=True))
    return document


def scene_of(layout: Layout, *, interfaces: bool = False) -> dict[str, Any]:
    """Return all scene data of a layout that a file with every element under its id does not draw."""
    layout = layout.drawn_from or layout
    facts = {key: value for key, value in document_of(layout).items() if key not in _DRAWN}
    if layout.assembly.dimension == 2:
        facts["thickness"] = layout.thickness
    if interfaces or layout.scene.interfaces:
        facts["interfaces"] = interfaces_of(layout)
    facts["elements"] = element_keys(layout)
    return facts


def facts_of(layout: Layout, *, cells: bool) -> dict[str, Any]:
    """Return name, units, materials and loads for a file of solids; `lost` names what else a scene states."""
    # cells: the file holds every element; otherwise loads refer to blocks. Resultant forces replace pressures. Of a
    # planar scene (x, y) becomes (x, 0, y), in the middle of the thickness.
    layout = layout.drawn_from or layout
    document = document_of(layout)
    facts: dict[str, Any] = {key: document[key] for key in ("name", "units", "source", "notes") if key in document}
    facts["materials"] = {key: value for key, value in document["materials"].items() if key != "faces"}
    lift = layout.assembly.dimension == 2
    if lift and isinstance(document["materials"].get("gravity"), list):
        gx, gy = document["materials"]["gravity"]
        facts["materials"]["gravity"] = [gx, 0.0, gy]
    for label in ("dry", "inner") if lift else ():
        for key, value in (document["materials"].get(label, {}).get("surface") or {}).items():
            if key not in _ALIKE or (key == "hoek_brown" and len(value.get("points", ())) != 1):
                where = f"materials.{label}.surface.{key}"
                raise InputError(where, "it speaks of the plane, and the file is spatial", '"friction" and "bending"')
    names = _names(layout, cells)

    def carried(loads: dict[str, Any], parsed: scene_loads.Loads | scene_loads.Case) -> dict[str, Any]:
        """Return "live" and "dead" of a load entry, converted for the file."""
        stated_loads = {key: loads[key] for key in ("live", "dead") if loads.get(key)}
        stated_loads = {
            key: _without_pressures(entries, getattr(parsed, key), layout) for key, entries in stated_loads.items()
        }
        return {key: [_load(entry, names, layout, lift) for entry in entries] for key, entries in stated_loads.items()}

    loads = layout.scene.loads
    facts["loads"] = carried(document["loads"], loads)
    if "cases" in document["loads"]:
        pairs = zip(document["loads"]["cases"], loads.cases or [], strict=True)
        facts["loads"]["cases"] = [case | carried(case, parsed) for case, parsed in pairs]
    if document["loads"].get("moving"):
        raise InputError("loads.moving", "a file of this kind has no place for them", "a scene without them")
    if lift and document["loads"].get("pushes"):
        problem = "its directions are those of the plane, and the file is spatial"
        raise InputError("loads.pushes", problem, '"cases" with body loads')
    if document["loads"].get("pushes"):
        facts["loads"]["pushes"] = document["loads"]["pushes"]
    return facts


def _without_pressures(entries: list[dict[str, Any]], parsed: Sequence[Any], layout: Layout) -> list[dict[str, Any]]:
    """Replace pressures in load entries by the forces and moments that they add up to."""
    assembly = layout.assembly
    boundary = build_loads.Boundary(assembly.elements, assembly.interfaces, layout.scene.plane_thickness)
    kept_entries = []
    for entry, load in zip(entries, parsed, strict=True):
        if "face" in entry:
            for traction in boundary.loads([load], "loads").tractions:
                force, moment = traction.resultant()
                where = {"element": assembly.elements.ids[traction.element], "at": traction.origin.tolist()}
                turn = moment.tolist() if assembly.dimension == 3 else float(moment[0])
                kept_entries.append({**where, "force": force.tolist(), **({"moment": turn} if moment.any() else {})})
        else:
            kept_entries.append(entry)
    return kept_entries


def _names(layout: Layout, cells: bool) -> Callable[[str], str]:
    """Return a function from element id to name in the file; InputError if its block holds a support."""
    if cells:
        return lambda name: name
    index, blocks = layout.assembly.elements.index, layout.blocks

    def of_block(name: str) -> str:
        block = blocks[int(layout.block_of[index[name]])]
        if block.support:
            problem = "it carries a load and is joined to a support, and a file of blocks has no load on supports"
            raise InputError(f"element {name!r}", problem, "a format that holds elements, or a joint at the support")
        return block.name

    return of_block


def _load(entry: dict[str, Any], names: Callable[[str], str], layout: Layout, lift: bool) -> dict[str, Any]:
    if (body := scene_loads.body_of(entry)) is not None:
        return {"body": _to_space(body) if lift else body}
    element = layout.assembly.elements.index[entry["element"]]
    load: dict[str, Any] = {"element": names(entry["element"])}
    if entry.get("force") is not None:
        # explicit, since the centroid of a block differs from that of its cell
        at = entry.get("at") or layout.assembly.elements.centroid[element].tolist()
        load["force"] = _to_space(entry["force"]) if lift else entry["force"]
        load["at"] = _to_space(at, 0.5 * layout.thickness) if lift else at
    if np.any(entry.get("moment", 0.0)):
        # counter-clockwise in the x–z plane is about −y
        load["moment"] = [0.0, -float(entry["moment"]), 0.0] if lift else entry["moment"]
    elif "force" not in load:
        load["moment"] = [0.0, 0.0, 0.0] if lift or layout.assembly.dimension == 3 else 0.0
    return load


def _to_space(vector: list[float], y: float = 0.0) -> list[float]:
    """Convert a planar vector (x, y) to (x, y0, y)."""
    return [vector[0], y, vector[1]]


def element_keys(layout: Layout) -> dict[str, dict[str, Any]]:
    """Return what a scene states of its elements beside shape and support, by id; not of grids."""
    entries = layout.scene.elements or []
    dumped = [uncertain.with_means(entry.model_dump(mode="json", exclude_defaults=True)) for entry in entries]
    keys_of: dict[str, dict[str, Any]] = {}
    for entry in dumped:
        keys_of[entry["id"]] = {key: value for key, value in entry.items() if key not in _SHAPE}
    return {name: keys for name, keys in keys_of.items() if keys}


def interfaces_of(layout: Layout) -> list[dict[str, Any]]:
    # Each entry states its two elements, polygon and label. It also holds the strengths and friction that the scene
    # states for this interface alone.
    layout = layout.drawn_from or layout
    assembly = layout.assembly
    faces, ids = assembly.interfaces, assembly.elements.ids
    values = _stated_values(layout.scene)
    return [
        {
            "elements": [ids[a], ids[b]],
            "polygon": rounded(polygon, assembly.size),
            "label": "dry" if dry else "inner",
            **values.get((ids[a], ids[b], origin.tobytes()), {}),
        }
        for a, b, polygon, origin, dry in zip(faces.a, faces.b, faces.polygon, faces.origin, layout.labels, strict=True)
    ]


def _stated_values(scene: Scene) -> dict[tuple[str, str, bytes], dict[str, Any]]:
    # Keys are the ids of its two elements and the bytes of its origin. Values are taken from the scene: an assembly
    # holds neither low values of a spread nor which key was given.
    if not scene.interfaces:
        return {}
    geometry = build_geometry(scene)
    faces, ids = geometry.interfaces, geometry.elements.ids
    return {
        (ids[a], ids[b], origin.tobytes()): uncertain.with_means(
            contact.model_dump(mode="json", exclude_defaults=True, exclude=_PLACE)
        )
        for a, b, origin, contact in zip(faces.a, faces.b, faces.origin, geometry.given, strict=True)
        if contact is not None
    }


# --- what is not kept ---------------------------------------------------------------------------------


def lost(layout: Layout, kind: str, *, cells: bool = False) -> list[str]:
    """Return what a scene states and a file of a format does not keep, as keys of the scene."""
    form, state = formats()[kind], (layout.assembly.dimension, cells)
    if state in form.whole:
        return []
    kept_keys = form.keeps + (form.keeps_of_cells if cells else ())
    document = document_of(layout)
    document.pop("labels", None)  # the labels of the layout are those that count
    inner = int(np.count_nonzero(~layout.labels[: layout.assembly.faces]))
    paths = dict.fromkeys(_paths(document))
    written = [path for path in paths if any(path == key or path.startswith(f"{key}.") for key in kept_keys)]
    lost_keys: dict[str, None] = {}
    for path in paths:
        if path not in written:
            parts = path.split(".")
            heads = [".".join(parts[: k + 1]) for k in range(len(parts))]
            # the highest key of which nothing is kept stands for all below it
            lost_keys[next(head for head in heads if not any(f"{key}.".startswith(f"{head}.") for key in written))] = (
                None
            )
    if inner and state not in form.labels:
        lost_keys[f"labels ({inner} inner face{'s' if inner > 1 else ''})"] = None
    return list(lost_keys)


def _paths(value: Any, head: str = "") -> Iterator[str]:
    """Yield the key of each value of a document, without places in lists: "loads.live.force"."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _paths(inner, f"{head}.{key}" if head else str(key))
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for inner in value:
            yield from _paths(inner, head)
    else:
        yield head


# Largest number of blocks whose order of laying is computed for a file, by dimension; it takes seconds for more
_MOST: Final = {2: 150, 3: 40}


@dataclass(frozen=True)
class BlockFacts:
    # block, elements: ids
    block: str
    elements: tuple[str, ...]
    support: bool
    mass: float  # scene units, kg with m and N
    volume: float  # scene units
    shape: int  # number of its mould, 0 for supports
    order: int | None  # number of the step in which it is laid, from 1; None for supports, and where none is computed
    load_factor: float | None  # λ of the layout; None without a collapse
    # dry, inner: neighbours across dry faces, and number of inner faces within it
    dry: tuple[str, ...]
    inner: int

    def entries(self) -> dict[str, Any]:
        """Return the facts by name, as texts and numbers, without those that are unknown."""
        entries = {
            "block": self.block,
            "elements": " ".join(self.elements),
            "support": self.support,
            "mass": self.mass,
            "volume": self.volume,
            "mould": self.shape or None,
            "order": self.order,
            "load_factor": self.load_factor,
            "dry_faces_to": " ".join(self.dry),
            "inner_faces": self.inner,
        }
        return {key: value for key, value in entries.items() if value is not None}


def block_facts(layout: Layout) -> list[BlockFacts]:
    assembly, labels = layout.assembly, layout.labels
    ids, faces = assembly.elements.ids, assembly.interfaces
    order = _order(layout)
    factor = None if layout.result is None else layout.result.load_factor
    a, b = layout.block_of[faces.a], layout.block_of[faces.b]
    facts = []
    for k, block in enumerate(layout.blocks):
        beside = {int(other) for other in np.concatenate([b[labels & (a == k)], a[labels & (b == k)]])} - {k}
        facts.append(
            BlockFacts(
                block=block.name,
                elements=tuple(ids[e] for e in block.elements),
                support=block.support,
                mass=float(f"{block.mass:.12g}"),
                volume=float(f"{block.volume:.12g}"),
                shape=block.shape,
                order=order.get(k),
                load_factor=None if factor is None or not np.isfinite(factor) else float(factor),
                dry=tuple(layout.blocks[other].name for other in sorted(beside)),
                inner=int((~labels & (a == k) & (b == k)).sum()),
            )
        )
    return facts


def _order(layout: Layout) -> dict[int, int]:
    """Return the step, from 1, in which each block is laid, by its index; empty where no order is known."""
    # The index is that in `Layout.blocks`.
    if sum(1 for block in layout.blocks if block.cells) > _MOST[layout.assembly.dimension]:
        return {}
    sideways = layout.scene.search.assemble_out_of_plane
    try:
        # groups of blocks that move together take minutes to find in space: jld assembly looks for them
        laying = plugins.part("assembly_order")(layout.assembly, layout.labels, sideways=sideways, group=1)
    except InputError:  # of what an assembly sequence does not model, as members and bond
        return {}
    return {
        int(layout.block_of[int(laying.blocks.elements(block)[0])]): number
        for number, step in enumerate(laying.steps, 1)
        for block in step.blocks
    }
