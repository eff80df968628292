"""Result of a limit analysis: λ with its bracket, status, forces and mechanism."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.limit.member_results import members_to_json
from jld_core.limit.model_facts import EffectiveAreas, ZeroDilation
from jld_core.limit.options import SolveOptions
from jld_core.limit.reasons import reason_of
from jld_core.limit.status import Status
from jld_core.notebook_repr import NotebookRepr

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class LimitAnalysisResult(NotebookRepr):
    """Result of the limit analysis of one assembly under one labelling.

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

    def __repr__(self) -> str:
        low, high = self.bracket
        numbers = "" if math.isnan(self.load_factor) else f", λ = {self.load_factor:.9g} in [{low:.9g}, {high:.9g}]"
        return f"LimitAnalysisResult({self.assembly.name!r}, {self.status}{numbers})"

    @property
    def friction(self) -> str:
        """Return the friction model, "associative" or "zero-dilation"."""
        return self.model.friction

    @property
    def contact(self) -> str:
        """Return the contact model, "convex" or "concave"."""
        return self.model.contact

    @property
    def reason(self) -> str | None:
        """Say which bound of an uncertified result is missing, and why.

        One sentence; None where no bound is missing.
        """
        return reason_of(self.status, self.bracket, self.gap, self.model.gap, self.facts) or None

    @property
    def warnings(self) -> list[str]:
        """Return the warnings about the scene and this result, one sentence each."""
        return [*self.assembly.warnings, *self.assembly.notes, *self.notes, *([self.reason] if self.reason else [])]

    @property
    def zero_dilation(self) -> ZeroDilation | None:
        """Return the evidence for a solution without dilation; None for associative friction."""
        return ZeroDilation.of(self.facts)

    @property
    def effective_areas(self) -> EffectiveAreas | None:
        """Return the convergence of effective areas; None without them."""
        return EffectiveAreas.of(self.facts)

    def plot(self, *, ids: bool = False, values: bool = False) -> Figure:
        """Draw labels, forces and mechanism side by side; of load cases, the governing one.

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
            "name": assembly.name,
            "load_factor": number(self.load_factor),
            "bracket": [number(end) for end in self.bracket],
            "gap": number(self.gap),
            "status": str(self.status),
            "stands_at_zero": self.stands_at_zero,
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
