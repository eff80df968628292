"""Plausibility warnings for scenes: numbers in a wrong unit, loads beside the structure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly, Elements
from jld_core.build.materials import friction, gravity_vector
from jld_core.geometry import moment_about
from jld_core.scene.materials import Dry
from jld_core.scene.schema import Contact, Scene
from jld_core.scene.units import GRAVITY, METRES, NEWTONS, STRESS, USUAL_GRAVITY, UnitSystem, powers_of
from jld_core.strengths import Route

_ROUTE: Final = Route("plausibility")

_FRICTION: Final = 2.0  # above this friction coefficient, an angle in degrees was probably meant
_ANGLE: Final = 2.0  # degrees: below, radians or the coefficient were probably given
_DENSITY: Final = (300.0, 9000.0)  # kg/m³, from light earth mixtures to steel
_STRENGTH: Final = 1e9  # Pa, upper limit of usual strengths
_CRUSHED: Final = 1e-3  # relative excess of a compressive strength over that which shear allows
_ANGLES: Final = (10.0, 60.0)  # degrees, limits of plausible angles of friction
_ELEMENT: Final = (1e-3, 1e3)  # m, limits of usual element sizes


@dataclass(frozen=True)
class Resultant:
    force: Floats  # (d,) sum of the forces, scene units
    # remaining couple: about the out-of-plane axis (planar; 0 unless the forces cancel) or along the force (spatial).
    # Where the forces cancel in space, the magnitude of the whole couple.
    moment: float
    # (d,) point of the line of action nearest to the middle of the structure; NaN where the forces cancel
    point: Floats
    total: float  # sum of the magnitudes of the forces

    @property
    def cancels(self) -> bool:
        """Return True if the forces add up to zero within rounding."""
        return bool(np.isnan(self.point).any())


def resultant(loads: Floats, elements: Elements) -> Resultant:
    """Compute force, moment and line of action of loads (n, q) about centroids on the free elements."""
    free = elements.free
    d = elements.centroid.shape[1]
    centre = 0.5 * (elements.lower.min(axis=0) + elements.upper.max(axis=0))
    forces, arm = loads[free, :d], elements.centroid[free] - centre
    force, total = forces.sum(axis=0), float(np.linalg.norm(forces, axis=1).sum())
    couple = (loads[free, d:] + moment_about(arm, forces)).sum(axis=0)
    if d == 2:
        moment = float(couple[0])
        if np.linalg.norm(force) <= 1e-9 * total or total == 0.0:
            return Resultant(force, moment, np.full(2, np.nan), total)
        arm_of_unit_moment = np.array([force[1], -force[0]]) / (force @ force)
        return Resultant(force, 0.0, centre + moment * arm_of_unit_moment, total)
    if np.linalg.norm(force) <= 1e-9 * total or total == 0.0:
        return Resultant(force, float(np.linalg.norm(couple)), np.full(3, np.nan), total)
    size = force @ force
    return Resultant(force, float(couple @ force / np.sqrt(size)), centre + np.cross(force, couple) / size, total)


def units_of(scene: Scene) -> UnitSystem:
    gravity = float(np.linalg.norm(gravity_vector(scene.materials, scene.dimension)))
    return UnitSystem.named(scene.units.force, scene.units.length, gravity)


def implausible(scene: Scene, assembly: Assembly) -> list[str]:
    """Return warnings about implausible numbers of a scene, with the usual range and the likely cause.

    In units of unknown names, only friction and keys without effect are judged.
    """
    units = units_of(scene)
    warnings = [*_of_no_use(scene), *_of_friction(scene), *_of_crushing(assembly)]
    if not units.known:
        return warnings
    warnings += [*_of_weight(scene, units), *_of_strengths(scene, assembly, units), *_of_geometry(assembly, units)]
    return warnings


def not_judged(scene: Scene) -> tuple[str, ...]:
    """Return a note on a scene in units of unknown names, whose numbers are not judged."""
    names = scene.units.length, scene.units.force
    unnamed = [name for name, names_in_si in zip(names, (METRES, NEWTONS), strict=True) if name not in names_in_si]
    if not unnamed:
        return ()
    text = " and ".join(repr(name) for name in unnamed)
    return (f"no unit is named {text}, so that densities, strengths and sizes could not be judged",)


def weight_facts(scene: Scene, assembly: Assembly) -> dict[str, str]:
    """Return thickness, density and weight of all free elements as texts with units.

    Parameters
    ----------
    scene : Scene
        Scene.
    assembly : Assembly
        Its structure.

    Returns
    -------
    dict of str to str
        Texts by name; absent facts are left out.
    """
    length, force = assembly.units
    units, elements = units_of(scene), assembly.elements
    facts = {} if scene.dimension == 3 else {"thickness": f"{scene.plane_thickness:g} {length}"}
    density = scene.materials.density
    if density is not None:
        facts["density"] = f"{density:g}"
        if units.known:
            mass = f"{density * units.density:.4g} kg/m³"
            facts["density"] = mass if units.density == 1.0 else f"{density:g}, {mass} in {_unit_names(scene)}"
    weight = float(np.linalg.norm(elements.weight[elements.free], axis=1).sum())
    facts["weight"] = f"{weight:.4g} {force}"
    if units.known and force != "kN":
        facts["weight"] += f" = {weight * units.si((1, 0)) / NEWTONS['kN']:.4g} kN"
    return facts


def _of_no_use(scene: Scene) -> Iterator[str]:
    """Warn about a thickness in a spatial scene, which has no effect."""
    if scene.dimension == 3 and scene.thickness is not None:
        yield f"thickness is {scene.thickness:g} and the elements are spatial, so it changes nothing"


def _within(value: float, usual: tuple[float, float]) -> bool:
    return usual[0] <= value <= usual[1]


def _meant(readings: dict[str, float], usual: tuple[float, float], unit: str = "", *, first: bool = False) -> str:
    """Describe which readings of an implausible number lie within the usual range."""
    likely = [f"{value:.4g}{unit} if {how}" for how, value in readings.items() if _within(value, usual)]
    return "".join(f"; {text}" for text in likely[: 1 if first else None])


def _of_friction(scene: Scene) -> Iterator[str]:
    sources: list[tuple[str, Dry | Contact]] = []
    if scene.materials.dry is not None:
        sources.append(("materials.dry", scene.materials.dry))
    sources += [(f"interfaces[{k}]", contact) for k, contact in enumerate(scene.interfaces or [])]
    for where, source in sources:
        value = friction(source)
        if value is None or value == 0.0:
            continue
        if source.friction_angle is not None and source.friction_angle < _ANGLE:
            meant = _meant({"it is in radians": float(np.degrees(source.friction_angle))}, _ANGLES, "°")
            yield f"{where}.friction_angle is {source.friction_angle:g}°; usual is 15 to 45{meant}"
        elif value > _FRICTION:
            if source.friction_angle is not None:
                yield f"{where}.friction_angle is {source.friction_angle:g}°; usual is 15 to 45"
            else:
                meant = f'; "friction_angle": {value:g} if degrees are meant' if _within(value, _ANGLES) else ""
                yield f"{where}.friction_coefficient is {value:g}; usual is 0.3 to 1{meant}"


def _of_weight(scene: Scene, units: UnitSystem) -> Iterator[str]:
    low, high = _DENSITY
    densities = [("materials.density", scene.materials.density)]
    densities += [(f"elements[{k}].density", element.density) for k, element in enumerate(scene.elements or [])]
    densities += [("fill.density", scene.fill.density)] if scene.fill is not None else []
    is_si = (scene.units.length, scene.units.force) == ("m", "N")
    for where, value in densities:
        mass = 0.0 if value is None else value * units.density
        if value is None or mass == 0.0 or low <= mass <= high:
            continue
        readings = {
            "kg/m³ are meant": np.nan if is_si else value,
            "t/m³ or g/cm³ are meant": 1e3 * value if value < high / 1e3 else np.nan,
            "a unit weight in kN/m³ is meant": value * 1e3 / 9.81,
            "a unit weight in N/m³ is meant": value / 9.81,
        }
        readings_in_range = _meant(readings, _DENSITY, first=True)
        intended = next((reading for reading in readings.values() if _within(reading, _DENSITY)), 2000.0)
        text = f"{value:g} kg/m³" if is_si else f"{value:g}, which is {mass:.4g} kg/m³ in {_unit_names(scene)}"
        remedy = "" if is_si else f'; write "density": "{intended:.4g} kg/m³", or {intended / units.density:.4g}'
        yield f"{where} is {text}; usual is {low:g} to {high:g}{readings_in_range}{remedy}"
    gravity = scene.materials.gravity
    if isinstance(gravity, float | int) and gravity < 0.0:
        yield f"materials.gravity is {gravity:g}; a number already acts downwards, so {-gravity:g} was probably meant"
    if units.gravity and not _within(units.acceleration, USUAL_GRAVITY):
        yield f"materials.gravity is {units.gravity:g} m/s²; usual is 9.81; 9.81 even where lengths were drawn in mm"


def _unit_names(scene: Scene) -> str:
    return f"{scene.units.length} and {scene.units.force}"


def _of_strengths(scene: Scene, assembly: Assembly, units: UnitSystem) -> Iterator[str]:
    """Warn about strengths above 1 GPa, or below the pressure of the structure's own weight."""
    pascals, own_pressure = units.si((1, -2)), _pressure_of_weight(assembly.elements, units)
    for where, number in _stated_strengths(scene):
        value = pascals * number
        text = f"{number:g} Pa" if pascals == 1.0 else f"{number:g}, which is {value:.4g} Pa in {_unit_names(scene)}"
        if value > _STRENGTH:
            readings = {"it was turned into Pa twice": value / 1e6, "Pa are meant": number}
            meant = _meant(readings, (own_pressure, _STRENGTH), first=True)
            yield f"{where} is {text}; usual is below {_STRENGTH:g} Pa (1 GPa){meant}"
        elif value < own_pressure:
            meant = _meant({"MPa are meant": 1e6 * number, "kPa are meant": 1e3 * number}, (own_pressure, _STRENGTH))
            yield (
                f"{where} is {text}, below the {own_pressure:.3g} Pa that the structure's own weight presses "
                f"with; usual is above{meant}"
            )


def _stated_strengths(scene: Scene) -> Iterator[tuple[str, float]]:
    """Yield key and number of each strength, those of yield surfaces and of criteria too."""
    strength_keys, labels = ("tensile_strength", "shear_strength", "compressive_strength"), ("dry", "inner")
    sources: list[tuple[str, Any]] = [(f"materials.{label}", getattr(scene.materials, label)) for label in labels]
    faces = enumerate(scene.materials.faces)
    sources += [(f"materials.faces[{k}].{label}", getattr(face, label)) for k, face in faces for label in labels]
    sources += [(f"interfaces[{k}]", contact) for k, contact in enumerate(scene.interfaces or [])]
    for where, source in sources:
        stated = {f"{where}.{name}": getattr(source, name, None) for name in strength_keys}
        for name, surface_part in (getattr(source, "surface", None) or {}).items():
            values_of_part = surface_part if isinstance(surface_part, dict) else {}
            stated |= {f"{where}.surface.{name}.{key}": values_of_part.get(key) for key in strength_keys}
        if getattr(source, "criterion", None) is not None:
            stresses = [name for name, powers in powers_of(source.criterion).items() if powers == STRESS]
            stated |= {f"{where}.parameters.{name}": source.parameters.get(name) for name in stresses}
        for key, number in stated.items():
            if number and isinstance(number, float | int):  # absent or zero: a model without this strength
                yield key, number


def _pressure_of_weight(elements: Elements, units: UnitSystem) -> float:
    """Return the pressure, Pa, below the free elements by their mean unit weight."""
    free = elements.free
    unit_weight = float(np.linalg.norm(elements.weight[free], axis=1).sum() / elements.volume[free].sum())
    vertical = np.argmax(abs(elements.weight[free].sum(axis=0)))
    height = float(np.ptp(np.concatenate([elements.lower[free], elements.upper[free]])[:, vertical]))
    # an implausible density has a warning of its own
    return min(units.si((1, -2)) * unit_weight * height, _DENSITY[1] * GRAVITY * units.si((0, 1)) * height)


def _of_crushing(assembly: Assembly) -> Iterator[str]:
    """Warn about compressive strengths that blocks which crack anywhere do not have (9.1)."""
    if assembly.face_strengths.criteria:
        return  # what such faces bear is for the criterion to say
    strengths, (length, force) = assembly.strengths(_ROUTE), assembly.units
    friction = strengths.inner_friction
    implied = 2.0 * strengths.shear * (friction + np.hypot(1.0, friction))
    for name, stated in (("inner", strengths.crush_inner), ("dry", strengths.crush_dry)):
        exceeds = np.isfinite(stated) & (implied > 0.0) & (stated > (1.0 + _CRUSHED) * implied)
        if exceeds.any():
            worst = int(np.argmax(np.where(exceeds, stated / implied, 0.0)))
            unit = f"{force}/{length}²"
            shear, slope = strengths.shear[worst], friction[worst]
            yield (
                f"materials.{name}.compressive_strength is {stated[worst]:g} {unit}, and blocks that crack anywhere "
                f"are crushed at {implied[worst]:g} {unit} = 2 τ (μ + √(1 + μ²)), by their shear strength τ = "
                f"{shear:g} and inner friction μ = {slope:g}: λ by faces and by fields differ; usual is a shear "
                f"strength of at least {stated[worst] * shear / implied[worst]:.4g}"
            )
            return


def _of_geometry(assembly: Assembly, units: UnitSystem) -> Iterator[str]:
    """Warn about implausible element sizes and, for each load case, the live load."""
    elements = assembly.elements
    extent = (elements.upper - elements.lower).max(axis=1)
    metres = units.si((0, 1)) * extent
    for is_extreme, relation, cause in (
        (metres < _ELEMENT[0], "below 1 mm", "lengths in a larger unit"),
        (metres > _ELEMENT[1], "above 1 km", "lengths in mm"),
    ):
        if is_extreme.any():
            first = int(np.flatnonzero(is_extreme)[0])
            count = int(np.count_nonzero(is_extreme))
            yield (
                f"element {elements.ids[first]!r} measures {extent[first]:.4g} {assembly.units[0]}"
                + (f" (and {count - 1} more are {relation})" if count > 1 else "")
                + f"; usual is 1 mm to 1 km; {cause} were probably meant"
            )
    for case in assembly.by_case:
        yield from _of_live(case)


def _of_live(assembly: Assembly) -> Iterator[str]:
    """Warn about a live load whose line of action passes far beside the structure."""
    elements = assembly.elements
    live = resultant(assembly.live, elements)
    if live.cancels:
        return
    low, high = elements.lower.min(axis=0), elements.upper.max(axis=0)
    direction = live.force / np.linalg.norm(live.force)
    corners = np.stack(np.meshgrid(*np.column_stack([low, high]), indexing="ij"), axis=-1).reshape(-1, len(low))
    arms = corners - live.point
    if len(low) == 2:
        offset = arms @ np.array([-direction[1], direction[0]])
        distance = 0.0 if offset.min() <= 0.0 <= offset.max() else float(abs(offset).min())
    else:
        # the distance of a line from the circumscribed ball is a lower bound of its distance from the box
        centre = 0.5 * (low + high) - live.point
        radius = 0.5 * float(np.linalg.norm(high - low))
        distance = float(np.linalg.norm(centre - (centre @ direction) * direction)) - radius
    if distance > assembly.size:
        where, unit = ", ".join(f"{x:.4g}" for x in live.point), assembly.units[0]
        yield (
            f"the line of action of the live load passes {distance:.4g} {unit} beside the structure (through {where}), "
            f'whose size is {assembly.size:.4g} {unit}; usual is through it; "at" is of the scene, not of the element'
        )
