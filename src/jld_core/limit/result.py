"""Result of a limit analysis: λ with its bracket, status, forces and mechanism."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.member_results import members_to_json
from jld_core.limit.model_facts import EffectiveAreas, ZeroDilation
from jld_core.limit.options import SolveOptions
from jld_core.limit.reasons import reason_of
from jld_core.limit.status import Status
from jld_core.notebook_repr import NotebookRepr
from jld_core.scene.cracks import cracks_in_short, cracks_to_json

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from jld_core.scene.cracks import CrackModel


class Result(NotebookRepr):
    """λ of one structure under one labelling, whatever the crack model: what all results have.

    Attributes
    ----------
    assembly : Assembly
        The structure analysed; by cells the finer cells.
    labels : (m,) bool array
        Labels of its interfaces, True = dry.
    cracks : "faces", CellCracks or FieldCracks
        Crack model.
    status : Status
        Outcome.
    load_factor : float
        λ, by fields its lower bound; NaN where there is none. With load cases: min over cases of λ / required.
    bracket : (float, float)
        Proven bounds on λ; NaN where a bound is unproven or infinite.
    gap : float
        Relative width of the bracket.
    stands_at_zero : bool or None
        True if the structure stands without live load, False if not; None where undecided.
    least_bracket : (float, float)
        Proven bounds on `least_load_factor`; NaN where unknown.
    governing : str or None
        Name of the governing load case.
    seconds : dict of str to float
        Wall-clock time of each part, and `total`.
    reason : str or None
        Which bound of an uncertified result is missing, and why.
    facts : dict
        Further facts of the model, as in the JSON output.
    notes : tuple of str
        Sentences about this result.
    forces, mechanism, instability_mechanism : (m, q) or (n, q) float array or None
        Of rigid elements, see `LimitAnalysisResult`; None by fields.
    """

    shown_by: ClassVar[str] = "jld_core.views.notebook:ResultView"

    assembly: Assembly
    labels: Bits
    cracks: CrackModel
    status: Status
    load_factor: float
    bracket: tuple[float, float]
    gap: float
    stands_at_zero: bool | None
    least_bracket: tuple[float, float]
    seconds: dict[str, float]
    reason: str | None
    facts: dict[str, Any]
    notes: tuple[str, ...]
    forces: Floats | None
    mechanism: Floats | None
    instability_mechanism: Floats | None

    def __repr__(self) -> str:
        (low, high), least = self.bracket, self.least_load_factor
        numbers = (
            "" if math.isnan(low) and math.isnan(high) else f", λ = {self.load_factor:.9g} in [{low:.9g}, {high:.9g}]"
        )
        falls = ""
        if self.stands_at_zero is False and self.status is not Status.UNSTABLE:
            falls = ", falls without live load" + ("" if math.isnan(least) else f", stands from λ = {least:.9g} on")
        words = f"{self.status}{numbers}{falls}, {cracks_in_short(self.cracks)}"
        return f"{type(self).__name__}({self.assembly.name!r}, {words})"

    @property
    def least_load_factor(self) -> float:
        """Return the least λ from which on the structure stands.

        It is 0 where the structure stands without live load, and NaN where it is unknown.
        """
        return 0.5 * sum(self.least_bracket)

    @property
    def warnings(self) -> list[str]:
        """Return the warnings about the scene and this result, one sentence each."""
        found = [*self.assembly.warnings, *self.assembly.notes, *self.notes, *([self.reason] if self.reason else [])]
        if self.cracks == "faces" and not self.labels[: self.assembly.faces].all():
            found.append(BY_FACES)
        if self.stands_at_zero is False and math.isfinite(self.load_factor):
            least = self.least_load_factor
            on = "" if math.isnan(least) else f"; it stands from λ = {least:.6g} on"
            found.append(f"the structure does not stand without live load, at λ = 0{on}")
        return found

    def plot(self, *, ids: bool = False, values: bool = False) -> Figure:
        """Draw the result: labels, forces and mechanism, or stresses and cracks; of load cases, the governing one.

        Parameters
        ----------
        ids : bool
            Also write the ids of the elements.
        values : bool
            Also write the values of live loads and forces.

        Returns
        -------
        matplotlib.figure.Figure
            Figure with three axes; save it by `savefig`.
        """
        figure: Figure = self.drawn(ids=ids, values=values)
        return figure

    def to_frame(self) -> pd.DataFrame:
        """Return the forces as a table with one row per interface.

        Returns
        -------
        pandas.DataFrame
            Index `face`; columns `element_a`, `element_b`, `label` ("dry" or "inner"), `length` (planar) or `area`,
            and the resultants that act on `element_b`: N (compression positive), V, M (planar), or N, V1, V2, M1, M2,
            MT (spatial). Resultants are NaN without forces. The dictionary `attrs["units"]` of the table holds the
            unit of each column in scene units, for example {"N": "kN", "M": "kN·m"}.
        """
        import pandas as pd  # slow to import and needed for tables only

        count, ids = self.assembly.faces, self.assembly.elements.ids
        faces = self.assembly.interfaces.take(np.arange(count))
        (length, force), names = self.assembly.units, self.assembly.resultants
        planar = self.assembly.dimension == 2
        size, unit = ("length", length) if planar else ("area", f"{length}²")
        forces = np.full((count, len(names)), np.nan) if self.forces is None else self.forces[:count]
        table = pd.DataFrame(
            {
                "element_a": [ids[a] for a in faces.a],
                "element_b": [ids[b] for b in faces.b],
                "label": np.where(self.labels[:count], "dry", "inner"),
                size: faces.l1 if planar else faces.area,
                **dict(zip(names, forces.T, strict=True)),
            },
            index=pd.RangeIndex(count, name="face"),
        )
        table.attrs["units"] = {size: unit, **{k: f"{force}·{length}" if k[0] == "M" else force for k in names}}
        return table

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld solve --json` prints.

        Returns
        -------
        dict
            Plain numbers, strings, lists and dicts; None stands for NaN and infinities.
        """
        raise NotImplementedError

    def _head(self) -> dict[str, Any]:
        """Return what the JSON output of every result begins with."""
        return {
            "name": self.assembly.name,
            "cracks": cracks_to_json(self.cracks),
            "load_factor": number(self.load_factor),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": str(self.status),
            "stands_at_zero": self.stands_at_zero,
            "least_load_factor": number(self.least_load_factor),
            "least_bracket": [number(end) for end in self.least_bracket],
        }


BY_FACES: Final = (
    "λ is that of blocks that crack along the faces drawn alone; cracks elsewhere may lower it: "
    "cracks by cells or by fields tell"
)
"""Warning about λ of blocks with inner faces, from cracks along faces."""


@dataclass(frozen=True, repr=False)
class LimitAnalysisResult(Result):
    """Result of the limit analysis of one assembly of rigid elements under one labelling.

    In a notebook it shows its main values and a drawing.

    Attributes
    ----------
    assembly : Assembly
        The structure analysed.
    labels : (m,) bool array
        Labels, True = dry.
    status : Status
        Outcome.
    load_factor : float
        λ, NaN where there is none. With load cases: the governing factor, min over cases of λ / required.
    bracket : (float, float)
        Proven bounds on `load_factor`; NaN where a bound is unproven or infinite.
    gap : float
        Relative width of the bracket; NaN for unstable and locked structures.
    stands_at_zero : bool or None
        True if λ = 0 is admissible, False if not; None where undecided.
    forces : (m, q) float array or None
        Resultants in scene units, admissible at `bracket[0]`: planar N, V, M; spatial N, V1, V2, M1, M2, MT. The last
        rows are those of members: compression beyond the prestress, and shear of pins. With load cases they are those
        of the governing case.
    mechanism : (n, q) float array or None
        Velocities about the centroids with b_λ·u = 1. With load cases they are those of the governing case.
    iterations : int
        Number of programs solved.
    solve_log : tuple of str
        Names of the methods tried, in order.
    seconds : dict of str to float
        Wall-clock time: assemble, solve, total.
    model : SolveOptions
        Model and solver options.
    facts : dict
        Further facts of the model, as in the JSON output. Those of zero dilation and of effective areas are also the
        fields of `zero_dilation` and `effective_areas`.
    cases : dict of str to LimitAnalysisResult
        Result of each load case by its name; empty without load cases.
    governing : str or None
        Name of the governing load case.
    instability_mechanism : (n, q) float array or None
        Velocities that prove that a structure is unstable; the largest displacement is 1.
    unbounded_forces : (m, q) float array or None
        Resultants per unit of λ that carry the live load of a locked structure without limit.
    notes : tuple of str
        Sentences about this result.
    cracks : "faces" or CellCracks
        Crack model; by cells `assembly` has the finer cells.
    least_bracket : (float, float)
        Proven bounds on the least λ from which on the structure stands, `least_load_factor`; NaN where unknown.
    """

    assembly: Assembly
    labels: Bits
    status: Status
    load_factor: float
    bracket: tuple[float, float]
    gap: float
    stands_at_zero: bool | None
    forces: Floats | None
    mechanism: Floats | None
    iterations: int
    solve_log: tuple[str, ...]
    seconds: dict[str, float]
    model: SolveOptions = field(default_factory=SolveOptions)
    facts: dict[str, Any] = field(default_factory=dict)
    cases: dict[str, LimitAnalysisResult] = field(default_factory=dict)
    governing: str | None = None
    instability_mechanism: Floats | None = None
    unbounded_forces: Floats | None = None
    notes: tuple[str, ...] = ()
    cracks: CrackModel = "faces"
    least_bracket: tuple[float, float] = (math.nan, math.nan)

    @property
    def friction(self) -> str:
        """Return the friction model, "associative" or "zero-dilation"."""
        return self.model.friction

    @property
    def contact(self) -> str:
        """Return the contact model, "convex" or "concave"."""
        return self.model.contact

    @property
    def reason(self) -> str | None:  # type: ignore[override]
        """Say which bound is missing, and why, or how far apart the bounds are if that is more than asked.

        One sentence; None where no bound is missing and the bracket is as narrow as asked.
        """
        return reason_of(self.status, self.bracket, self.gap, self.model.gap, self.facts) or None

    @property
    def zero_dilation(self) -> ZeroDilation | None:
        """Return the evidence for a solution without dilation; None for associative friction."""
        return ZeroDilation.of(self.facts)

    @property
    def effective_areas(self) -> EffectiveAreas | None:
        """Return the convergence of effective areas; None without them."""
        return EffectiveAreas.of(self.facts)

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld solve --json` prints, see `Result.to_json`."""
        assembly = self.assembly
        ids, faces = assembly.elements.ids, assembly.interfaces.take(np.arange(assembly.faces))
        forces = None
        if self.forces is not None:
            forces = [
                {
                    "elements": [ids[a], ids[b]],
                    "label": "dry" if dry else "inner",
                    **{name: float(value) for name, value in zip(assembly.resultants, row, strict=True)},
                }
                for a, b, dry, row in zip(faces.a, faces.b, self.labels, self.forces, strict=False)
            ]
        mechanism = None
        if self.mechanism is not None:
            mechanism = {name: [float(v) for v in row] for name, row in zip(ids, self.mechanism, strict=True)}
        unstable = None
        if self.instability_mechanism is not None:
            unstable = {name: row.tolist() for name, row in zip(ids, self.instability_mechanism, strict=True)}
        return {
            **self._head(),
            "friction": self.friction,
            "contact": self.contact,
            "dimension": assembly.dimension,
            "elements": len(assembly.elements),
            "interfaces": len(faces),
            "iterations": self.iterations,
            "solve_log": list(self.solve_log),
            "seconds": dict(self.seconds),
            "warnings": self.warnings,
            **self.facts,
            **(
                {"governing": self.governing, "cases": {name: one.to_json() for name, one in self.cases.items()}}
                if self.cases
                else {}
            ),
            "mechanism": mechanism,
            "instability_mechanism": unstable,
            "forces": forces,
            **({"members": members_to_json(assembly, self.forces, self.mechanism)} if assembly.members else {}),
            "faces": _faces(assembly, self.labels),
        }


def _faces(assembly: Assembly, labels: Bits) -> list[dict[str, Any]]:
    """Return the JSON entries of all faces: elements, label, local frame and size.

    labels: (m,) True = dry. Values are in scene units. They suffice to check equilibrium and yield by hand.
    """
    faces, ids = assembly.interfaces, assembly.elements.ids
    planar = assembly.dimension == 2
    found = []
    for k in range(assembly.faces):
        frame = {"origin": faces.origin[k], "normal": faces.normal[k], "e1": faces.e1[k]}
        frame |= {} if planar else {"e2": faces.e2[k]}
        size = {"length": float(faces.l1[k])} if planar else {"area": float(faces.area[k])}
        found.append(
            {
                "index": k,
                "elements": [ids[faces.a[k]], ids[faces.b[k]]],
                "label": "dry" if labels[k] else "inner",
                **{name: [float(value) for value in vector] for name, vector in frame.items()},
                **size,
            }
        )
    return found


def stands_in_words(found: Result) -> str:
    """Say whether a structure stands without live load, and if not, from which λ on it does.

    Parameters
    ----------
    found : Result
        Its result.

    Returns
    -------
    str
        Words for a table of facts.
    """
    stands, least = found.stands_at_zero, found.least_load_factor
    if stands is not False or math.isnan(least):
        return "undecided" if stands is None else "yes" if stands else "no"
    return f"no, from λ = {least:.9g} on"


def number(value: float) -> float | None:
    """Return a float as a JSON number.

    Parameters
    ----------
    value : float
        Any float.

    Returns
    -------
    float or None
        The value; None for NaN and infinities.
    """
    return float(value) if np.isfinite(value) else None
