"""Strengths of faces; a **route**, a reader of them, is refused unless it knows every **fact** in them.

A fact is a kind of statement, such as friction of joints or a criterion of a plug-in.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from jld_core import plugins
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.errors import InputError
from jld_core.parameters import near
from jld_core.scene.complaints import first_complaint, shown
from jld_core.scene.standard import ENDS, PARAMETERS, SURFACE

FACTS: Final[Mapping[str, tuple[str, str]]] = {
    **{one.fact: (one.where, one.words) for one in PARAMETERS},
    "dry criterion": ("materials.dry.criterion", "criterion"),
    "inner criterion": ("materials.inner.criterion", "criterion"),
}
"""Key of a scene and a name in words for each fact about strengths."""

ADHESION: Final = frozenset({"cohesion"})  # facts of joints that resist shear without pressure
CRITERIA: Final = frozenset({"dry criterion", "inner criterion"})  # facts of yield criteria that plug-ins add
STANDARD: Final = frozenset(FACTS) - CRITERIA  # facts of the standard criterion
GROUP: Final = "jld.criteria"  # group of entry points of yield criteria


@dataclass(frozen=True)
class Route:
    """One reader of strengths: its name in messages, and the facts that it knows.

    Parameters
    ----------
    name : str
        Name in messages.
    KNOWS : frozenset of str
        Facts, keys of `FACTS`; default: those of the standard criterion.
    """

    name: str
    KNOWS: frozenset[str] = STANDARD


@dataclass(frozen=True)
class Side:
    """Numbers (m,) of the standard criterion under one label.

    Tension σt, shear c (resistance without N), friction μ, crush σc (inf: none).
    """

    tension: Floats
    shear: Floats
    friction: Floats
    crush: Floats


@dataclass(frozen=True)
class Strengths:
    """Strengths of m interfaces, each as dry and as inner, in scene units; `side` and `under` give those of a label.

    The values of a material that the scene does not state are NaN.

    Parameters
    ----------
    friction : (m,) array
        Friction coefficient μ of dry faces.
    tension, shear : (m,) array
        Tensile and shear strength σt and τ of inner faces, stress.
    crush_dry, crush_inner : (m,) array
        Compressive strength, stress; inf where none is given.
    cohesion : (m,) array
        Cohesion of dry faces, stress; 0 where none is given.
    inner_friction : (m,) array
        Friction coefficient μ of inner faces; 0 where none is given.
    """

    friction: Floats
    tension: Floats
    shear: Floats
    crush_dry: Floats
    crush_inner: Floats
    cohesion: Floats
    inner_friction: Floats

    @classmethod
    def of(cls, dry: Side, inner: Side) -> Strengths:
        """Return strengths from the numbers of either label; dry faces have no tension."""
        return cls(
            **{
                parameter.field: getattr(dry if parameter.label == "dry" else inner, parameter.side)
                for parameter in PARAMETERS
            }
        )

    def side(self, *, dry: bool) -> Side:
        label = "dry" if dry else "inner"
        numbers = {p.side: getattr(self, p.field) for p in PARAMETERS if p.label == label}
        return Side(**{"tension": np.zeros(len(self.friction)), **numbers})

    def under(self, labels: Bits) -> Side:
        dry, inner = self.side(dry=True), self.side(dry=False)
        return Side(**{name: np.where(labels, value, getattr(inner, name)) for name, value in vars(dry).items()})

    def changed(
        self, stress: Callable[[Floats], Floats], friction: Callable[[Floats], Floats] = lambda mu: mu
    ) -> Strengths:
        """Return strengths with a function applied to all stresses, and one to friction coefficients."""
        return Strengths(
            **{
                parameter.field: (friction if parameter.side == "friction" else stress)(getattr(self, parameter.field))
                for parameter in PARAMETERS
            }
        )

    @property
    def stresses(self) -> dict[str, Floats]:
        return {
            parameter.field: getattr(self, parameter.field) for parameter in PARAMETERS if parameter.side != "friction"
        }

    @property
    def crushes(self) -> Bools:
        """Return a mask (m,) of the faces that have a compressive strength under either label."""
        return np.asarray(np.isfinite(self.crush_dry) | np.isfinite(self.crush_inner))

    def take(self, rows: Ints) -> Strengths:
        return Strengths(**{name: values[rows] for name, values in vars(self).items()})

    def joined(self, further: Strengths) -> Strengths:
        mine, theirs = vars(self), vars(further)
        return Strengths(**{name: np.concatenate([mine[name], theirs[name]]) for name in mine})

    def facts(self) -> dict[str, Bools]:
        """Return for each fact a mask (m,) of the interfaces that state it."""
        values = [(parameter, getattr(self, parameter.field)) for parameter in PARAMETERS]
        return {p.fact: np.isfinite(value) if p.field in ENDS else value > 0.0 for p, value in values}


@dataclass(frozen=True)
class StatedCriterion:
    """Criterion of a plug-in for some interfaces under one label, as a scene states it."""

    label: str
    name: str  # name of its entry point
    values: Any  # parameters, scene units: numbers by name, or an instance of the model of the criterion
    faces: Bools  # (m,) interfaces that have this criterion

    @property
    def key(self) -> str:
        return f"materials.{self.label}.{SURFACE if self.name == SURFACE else 'criterion'}"

    def take(self, rows: Ints) -> StatedCriterion:
        return replace(self, faces=self.faces[rows])


@dataclass(frozen=True)
class FaceStrengths:
    """Owner of the strengths of m interfaces, which `Assembly.strengths` hands out.

    Nominal numbers stand beside stated ones that are the low values of materials.
    """

    _stated_numbers: Strengths
    _nominal_numbers: Strengths | None = None
    criteria: tuple[StatedCriterion, ...] = field(default=())

    @property
    def has_low_values(self) -> bool:
        return self._nominal_numbers is not None

    def facts(self) -> dict[str, Bools]:
        """Return for each fact a mask (m,) of the interfaces that state it."""
        masks = self._stated_numbers.facts()
        for criterion in self.criteria:
            fact = f"{criterion.label} criterion"
            masks[fact] = masks[fact] | criterion.faces if fact in masks else criterion.faces
        return masks

    def numbers(
        self, route: Route, among: Bools, labels: Bits | None = None, name: Callable[[int], str] = str
    ) -> Strengths:
        """Return the strengths for a route; InputError for a fact of interfaces `among` (m,) that it does not know.

        labels: (m,); without them a fact of either label counts. name: of an interface, for the error.
        """
        for fact, stated in self.facts().items():
            if fact in route.KNOWS:
                continue
            is_of_dry = FACTS[fact][0].startswith("materials.dry")
            concerned = stated & among
            if labels is not None:
                concerned = concerned & (labels if is_of_dry else ~labels)
            if concerned.any():
                raise self._unknown(fact, concerned, route, name(int(np.flatnonzero(concerned)[0])))
        return self._stated_numbers

    def _unknown(self, fact: str, concerned: Bools, route: Route, face: str) -> InputError:
        """Return the error of an unknown fact of the interfaces `concerned` (m,)."""
        key, words = FACTS[fact]
        if fact in CRITERIA:
            of_label = [c for c in self.criteria if fact.startswith(c.label)]
            criterion = next(c for c in of_label if (c.faces & concerned).any())
            return InputError(
                criterion.key, f'"{criterion.name}" is unknown to {route.name}', "standard strengths in place of it"
            )
        return InputError(key, f"the {words} (face {face}) is unknown to {route.name}", "faces without it")

    def with_numbers(self, numbers: Strengths) -> FaceStrengths:
        """Return the same criteria with other strengths, and without nominal ones."""
        return replace(self, _stated_numbers=numbers, _nominal_numbers=None)

    def low_of(self, weak: FaceStrengths) -> FaceStrengths:
        return replace(weak, _nominal_numbers=self._stated_numbers)

    def at_nominal(self) -> FaceStrengths:
        """Return the nominal strengths alone; these themselves without low values."""
        return replace(self, _stated_numbers=self._nominal_numbers or self._stated_numbers, _nominal_numbers=None)

    def without_nominal(self) -> FaceStrengths:
        return replace(self, _nominal_numbers=None)

    def take(self, rows: Ints) -> FaceStrengths:
        nominal = None if self._nominal_numbers is None else self._nominal_numbers.take(rows)
        return FaceStrengths(
            self._stated_numbers.take(rows), nominal, tuple(criterion.take(rows) for criterion in self.criteria)
        )

    def joined(self, further: Strengths) -> FaceStrengths:
        """Return these strengths, followed by those of further interfaces of the standard criterion."""
        nominal = None if self._nominal_numbers is None else self._nominal_numbers.joined(further)
        no_faces = np.zeros(len(further.friction), dtype=bool)
        criteria = tuple(replace(criterion, faces=np.append(criterion.faces, no_faces)) for criterion in self.criteria)
        return FaceStrengths(self._stated_numbers.joined(further), nominal, criteria)

    def scaled(self, factors: Mapping[str, float], faces: Bools) -> FaceStrengths:
        """Return the strengths with those of `faces` (m,) bool times factors, by names of fields."""

        def times(numbers: Strengths) -> Strengths:
            items = vars(numbers).items()
            return Strengths(**{key: np.where(faces, factors.get(key, 1.0) * x, x) for key, x in items})

        nominal = None if self._nominal_numbers is None else times(self._nominal_numbers)
        return replace(self, _stated_numbers=times(self._stated_numbers), _nominal_numbers=nominal)

    def table(self) -> Floats:
        """Return one row (m, k) for each interface, equal for equal strengths and criteria; NaN: no material."""
        strengths = [self._stated_numbers, *([] if self._nominal_numbers is None else [self._nominal_numbers])]
        columns = [column for numbers in strengths for column in vars(numbers).values()]
        columns += [criterion.faces.astype(float) for criterion in self.criteria]
        return np.column_stack(columns).reshape(len(self._stated_numbers.friction), -1)


@dataclass(frozen=True)
class Parameter:
    """Parameter of a criterion.

    Attributes
    ----------
    name : str
        Key in a scene.
    unit : str
        Unit in words, such as "stress", "length" or "" for a number.
    least, most : float
        Bounds; a value may equal them.
    default : float or None
        Value where a scene states none; None: a scene must state it.
    """

    name: str
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    default: float | None = None


def stated(label: str, name: str, parameters: Mapping[str, Any], key: str) -> Any:
    """Return the parameters of a criterion that a scene states, with defaults; raise InputError for wrong ones."""
    criterion = criterion_of(name, f"{key}.criterion")
    if criterion.label not in (label, "either"):
        expected = f'"materials.{criterion.label}" for it'
        raise InputError(f"{key}.criterion", f'"{name}" is for {criterion.label} faces', expected)
    if isinstance(criterion.parameters, type):
        model: Any = criterion.parameters
        where = f"{key}.{SURFACE if name == SURFACE else 'parameters'}"
        try:
            return model.model_validate(parameters)
        except ValidationError as error:
            complaint = first_complaint(error, model)
        raise InputError(f"{where}.{complaint.where}".rstrip("."), complaint.problem, complaint.expected)
    by_name = {parameter.name: parameter for parameter in criterion.parameters}
    for key_given in parameters:
        if key_given not in by_name:
            likely = difflib.get_close_matches(key_given, by_name, n=1) or by_name
            names = ", ".join(f'"{parameter}"' for parameter in likely) or "no parameters"
            raise InputError(f"{key}.parameters.{key_given}", f'"{name}" has no such parameter', names)
    values = {}
    for parameter in criterion.parameters:
        value = parameters.get(parameter.name, parameter.default)
        unit = f", {parameter.unit}" if parameter.unit else ""
        bounds = f"a number from {parameter.least:g} to {parameter.most:g}{unit}"
        if value is None:
            raise InputError(f"{key}.parameters.{parameter.name}", f'missing, and "{name}" needs it', bounds)
        is_number = type(value) in (int, float)
        if not is_number or not parameter.least <= value <= parameter.most:
            shape = f"{value:g}" if is_number else shown(value)
            raise InputError(f"{key}.parameters.{parameter.name}", f"it is {shape}", bounds)
        values[parameter.name] = float(value)
    return values


def criterion_of(name: str, key: str) -> Any:
    """Return the criterion of an entry point, an instance or a class without arguments."""
    installed = list(plugins.entry_points(GROUP))
    if name not in installed:
        expected = near(name, installed) if installed else f"an installed package with an entry point in {GROUP}"
        raise InputError(key, f'no installed package adds "{name}"', expected)
    criterion = plugins.load(GROUP, name)
    with plugins.guarded(GROUP, name):
        criterion = criterion() if isinstance(criterion, type) else criterion
    missing = [attribute for attribute in ("label", "parameters", "rows") if not hasattr(criterion, attribute)]
    if missing:
        raise plugins.refuse_type(GROUP, name, f'an object with label, parameters and rows; it has no "{missing[0]}"')
    if criterion.label not in ("dry", "inner", "either"):
        raise plugins.refuse_type(GROUP, name, f'"dry", "inner" or "either" as label in place of {criterion.label!r}')
    return criterion
