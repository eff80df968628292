"""Conversion of a validated scene to an assembly: geometry, loads, strengths and labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from jld_core.arrays import Bits, Bools
from jld_core.assembly import DRY, INNER, Assembly, Elements, Interfaces, LoadCase
from jld_core.build import materials
from jld_core.build.elements import Geometry, faces_of_pairs, planar_geometry, spatial_geometry, with_self_weights
from jld_core.build.fill import Backing
from jld_core.build.loads import Boundary, PlacedCase, cases_of, cases_of_pushes
from jld_core.build.materials import with_bond, with_members
from jld_core.build.plausibility import implausible, not_judged
from jld_core.errors import InputError
from jld_core.linalg import components
from jld_core.loads import Loads, resultants
from jld_core.parameters import typed
from jld_core.scene.loads import require_unique_names
from jld_core.scene.materials import FaceMaterial
from jld_core.scene.reading import at_low, load_scene
from jld_core.scene.schema import Contact, Scene
from jld_core.scene.uncertain import in_words, uncertain_values
from jld_core.strengths import FaceStrengths

LABELS = {"dry": DRY, "inner": INNER}  # label values by their names in a scene: True = dry, False = inner
_NAMED = 4  # largest number of values with uncertainty that a sentence names


def build_geometry(scene: Scene) -> Geometry:
    """Compute the elements and interfaces of a scene, which are independent of materials and loads.

    Raises InputError: geometry or references are invalid, or an element has no path of interfaces to a support.

    Parameters
    ----------
    scene : Scene
        Scene.

    Returns
    -------
    Geometry
        Elements without weights, interfaces, and the scene's own entries for both.
    """
    geometry = spatial_geometry(scene) if scene.dimension == 3 else planar_geometry(scene)
    _check_paths(geometry)
    return geometry


def build_robust(scene: Scene) -> Assembly:
    """Convert a scene to an assembly with the low values of its materials.

    Parameters
    ----------
    scene : Scene
        Scene with at least one material value that has a low value.

    Returns
    -------
    Assembly
        Assembly with low strengths; `at_nominal` has the nominal ones.

    Raises
    ------
    InputError
        No material value has a low value, or as in `build_assembly`.
    """
    low = at_low(scene)
    nominal, robust = build_assembly(scene), build_assembly(low)
    if len(robust.interfaces) != len(nominal.interfaces):
        raise InputError("members", "a low tension equals the prestress", "a low tension above it")
    low_values = nominal.face_strengths.low_of(robust.face_strengths)
    return replace(nominal, face_strengths=low_values, members=robust.members)


@typed
def build_assembly(scene: Scene | str | Path | Mapping[str, Any], geometry: Geometry | None = None) -> Assembly:
    """Convert a scene to an assembly, in scene units.

    Parameters
    ----------
    scene : Scene, str, Path or dict
        Validated scene, the name of a scene file or its content.
    geometry : Geometry, optional
        Geometry of a scene that differs only in materials and loads, to save its computation.

    Returns
    -------
    Assembly
        Elements, interfaces, load cases, strengths, the scene's own labels, and plausibility warnings.

    Raises
    ------
    InputError
        Geometry, references, loads or materials are invalid; the message names them.
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    geometry = build_geometry(scene) if geometry is None else geometry
    interfaces, given = geometry.interfaces, geometry.given
    elements = with_self_weights(geometry.elements, geometry.entries, scene)
    of_faces = _face_materials(scene, elements, interfaces)
    boundary = Boundary(elements, interfaces, scene.plane_thickness, _backing(scene, elements))
    cases = _cases(scene, boundary)
    assembly = Assembly(
        name=scene.name,
        dimension=scene.dimension,
        units=(scene.units.length, scene.units.force),
        elements=elements,
        interfaces=interfaces,
        face_strengths=FaceStrengths(
            materials.strengths(scene.materials, given, of_faces),
            criteria=materials.criteria(scene.materials, given, of_faces),
        ),
        dead_loads=cases[0].dead_loads,
        live_loads=cases[0].live_loads,
        labels=_labels_of_scene(scene, elements, interfaces, given),
        moved=geometry.moved,
        cases=cases if scene.loads.has_cases else (),
        touching=geometry.touching,
        fill=boundary.backing.outlines() if boundary.backing is not None else (),
    )
    warnings = (*geometry.warnings, *implausible(scene, assembly))
    notes = (*not_judged(scene), *noted_means(scene), *_glued_supports(scene, assembly))
    assembly = replace(assembly, warnings=warnings, notes=notes, cracks=scene.cracks, scene=scene)
    assembly = with_bond(assembly, scene.materials, of_faces)
    pressures = None if boundary.backing is None else boundary.backing.pressures()
    return with_members(assembly, scene.members, pressures)


def _backing(scene: Scene, elements: Elements) -> Backing | None:
    """Return the fill of a scene on its elements, if any; raise InputError for a spatial scene."""
    if scene.fill is None:
        return None
    if scene.dimension == 3:
        raise InputError("fill", "it is for planar scenes", "loads in place of it")
    down, gravity = materials.direction_of_weight(scene), materials.gravity_vector(scene.materials, 2)
    return Backing(scene.fill, elements, down, float(np.linalg.norm(gravity)), scene.plane_thickness)


def noted_means(scene: Scene) -> tuple[str, ...]:
    """Return a note that uncertain values are taken at their means; () if there are none."""
    names = [in_words(path) for path, _ in uncertain_values(scene)]
    if not names:
        return ()
    others = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return (f"the means stand for values with uncertainty ({', '.join(names[:_NAMED])}{others}): see jld reliability",)


def _glued_supports(scene: Scene, assembly: Assembly) -> tuple[str, ...]:
    """Return a note that the default label glues supports which could be joints; () where none is."""
    elements, faces = assembly.elements, assembly.interfaces
    count = int((~assembly.labels & (elements.support[faces.a] | elements.support[faces.b])).sum())
    states_labels = scene.labels.inner or any(contact.label for contact in scene.interfaces or [])
    if scene.labels.default != "inner" or scene.materials.dry is None or states_labels or not count:
        return ()
    faces_to_supports = "1 face to a support" if count == 1 else f"{count} faces to supports"
    return (f'labels.default "inner" glues {faces_to_supports} too; "labels.dry" lists pairs that are joints',)


def _face_materials(scene: Scene, elements: Elements, interfaces: Interfaces) -> list[FaceMaterial | None]:
    entry_of: list[FaceMaterial | None] = [None] * len(interfaces)
    for position, entry in enumerate(scene.materials.faces):
        where = f"materials.faces[{position}].between"
        of_pair = faces_of_pairs([entry.between], elements, interfaces, where)
        for face in np.flatnonzero(of_pair).tolist():
            if entry_of[face] is not None:
                raise InputError(where, f"{' and '.join(entry.between)} are given twice", "one entry for each pair")
            entry_of[face] = entry
    return entry_of


def _check_paths(geometry: Geometry) -> None:
    """Raise InputError for an element without a path of interfaces to a support."""
    # Equilibrium of such an element has no solution.
    elements, interfaces = geometry.elements, geometry.interfaces
    component = components(len(elements), interfaces.a, interfaces.b)
    reached = np.isin(component, component[elements.support])
    if not reached.all():
        loose = elements.ids[int(np.flatnonzero(~reached)[0])]
        causes = [*_touching(elements, reached), *geometry.warnings]
        raise InputError(
            f"element {loose!r}",
            "no path of interfaces leads from it to a support" + "".join(f" ({cause})" for cause in causes),
            "every free element joined to a support through faces that touch",
        )


def _touching(elements: Elements, reached: Bools) -> list[str]:
    """Return which two planar elements touch at a point alone, of those with and without a path to a support."""
    if elements.centroid.shape[1] != 2:
        return []
    size = float((elements.upper.max(axis=0) - elements.lower.min(axis=0)).max())
    shapes = shapely.polygons([shapely.linearrings(shape) for shape in elements.shape])
    grounded, loose = np.flatnonzero(reached), np.flatnonzero(~reached)
    for k in grounded.tolist():
        touched = loose[shapely.dwithin(shapes[k], shapes[loose], 1e-9 * size)]
        for j in touched[shapely.length(shapely.intersection(shapes[k], shapes[touched])) < 1e-6 * size].tolist():
            return [f"{elements.ids[k]!r} and {elements.ids[j]!r} touch at a point alone"]
    return []


def _labels_of_scene(scene: Scene, elements: Elements, interfaces: Interfaces, contacts: list[Contact | None]) -> Bits:
    """Return the labels (m,) that the scene states; raise InputError for unknown elements, or a pair in both lists."""
    # The first of these that exists counts: label of the interface, lists "dry" and "inner", default. Otherwise faces
    # inside a named block are inner, except those at supports, and all others are dry.
    block_number = {name: n for n, name in enumerate(dict.fromkeys(elements.blocks))}
    block = np.array([-1 if name is None else block_number[name] for name in elements.blocks])
    in_one_block = (block[interfaces.a] == block[interfaces.b]) & (block[interfaces.a] >= 0)
    support = elements.support[interfaces.a] | elements.support[interfaces.b]
    labels = np.where(in_one_block & ~support, INNER, DRY)
    if scene.labels.default is not None:
        labels = np.full(len(interfaces), LABELS[scene.labels.default])
    inner = faces_of_pairs(scene.labels.inner, elements, interfaces, "labels.inner")
    dry = faces_of_pairs(scene.labels.dry, elements, interfaces, "labels.dry")
    if np.any(inner & dry):
        face = int(np.flatnonzero(inner & dry)[0])
        pair = f"{elements.ids[interfaces.a[face]]!r}, {elements.ids[interfaces.b[face]]!r}"
        raise InputError("labels", f"the pair {pair} is listed under both inner and dry", "each pair under one")
    labels = np.where(inner, INNER, np.where(dry, DRY, labels))
    for face, contact in enumerate(contacts):
        if contact is not None and contact.label is not None:
            labels[face] = LABELS[contact.label]
    return labels.astype(bool)


def _cases(scene: Scene, boundary: Boundary) -> tuple[LoadCase, ...]:
    """Return the load cases of a scene, each including the common dead load and self-weight."""
    # A scene without "cases" has one case with an empty name.
    elements = boundary.elements
    common = boundary.loads(scene.loads.dead, "loads.dead")
    fill = () if boundary.backing is None else tuple(boundary.backing.permanent())
    weight = np.where(elements.support[:, None], 0.0, elements.weight)
    common = replace(common, body=common.body + weight, tractions=common.tractions + fill)
    if not scene.loads.has_cases:
        live = boundary.loads(scene.loads.live or [], "loads.live")
        return (_case("", "loads", common, live, 1.0, elements),)
    cases = []
    for key, case, place in cases_of_scene(scene, elements):
        dead, live = boundary.loads(case.dead, f"{key}.dead"), boundary.loads(case.live, f"{key}.live")
        cases.append(replace(_case(case.name, key, common + dead, live, case.required, elements), place=place))
    return tuple(cases)


def cases_of_scene(scene: Scene, elements: Elements) -> list[PlacedCase]:
    """Return the load cases of a scene, with those of moving loads and pushes.

    Raises InputError for invalid paths or directions, and for names used twice.

    Parameters
    ----------
    scene : Scene
        Scene.
    elements : Elements
        Its elements.

    Returns
    -------
    list of PlacedCase
        Load cases.
    """
    direction, backing = materials.direction_of_weight(scene), _backing(scene, elements)
    cases = [PlacedCase(f"loads.cases[{position}]", case) for position, case in enumerate(scene.loads.cases or [])]
    for position, moving in enumerate(scene.loads.moving or []):
        key = f"loads.moving[{position}]"
        cases += cases_of(moving, elements, direction, key, backing)
    if scene.loads.pushes is not None:
        pushes = cases_of_pushes(scene.loads.pushes, direction, "loads.pushes")
        cases += [PlacedCase("loads.pushes", case) for case in pushes]
    require_unique_names("loads", [load.case.name for load in cases])
    return cases


def _case(name: str, key: str, dead: Loads, live: Loads, required: float, elements: Elements) -> LoadCase:
    if not np.any(resultants(live, elements)):
        raise InputError(f"{key}.live", "the live load is zero", "at least one load that acts on a free element")
    return LoadCase(name, dead, live, required)
