"""Result of a limit analysis: λ with its bracket, status, forces and mechanism."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from jld_core.arrays import Bits, Floats
from jld_core.assembly import Assembly
from jld_core.geometry import spun
from jld_core.limit.bounds import Proof, load_scale, relative_width
from jld_core.limit.options import CaseBounds, EffectiveAreas, SolveOptions, Status, ZeroDilation, governing, reason_of
from jld_core.notebook_repr import NotebookRepr
from jld_core.program import Template
from jld_core.scene.cracks import cracks_in_short, cracks_to_json

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from jld_core.scene.cracks import CrackModel


def without_idle(assembly: Assembly, forces: Floats) -> Floats:
    """Set the resultants that a member cannot carry to zero, and subtract the bond from N.

    A bar carries only axial force; a pin carries shear, and axial force only where it states a capacity. The program
    leaves the other numbers free. Bond is the constant force of joints with tensile strength.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    forces : (m, q) array
        Resultants, scene units.

    Returns
    -------
    (m, q) array
        Resultants.
    """
    members, carried = assembly.members, forces
    if members.bond is not None:
        carried = forces.copy()
        carried[: assembly.faces, 0] -= members.bond
    for k in np.flatnonzero(members.face >= 0).tolist():
        carried = forces.copy() if carried is forces else carried
        row = carried[members.face[k]]
        if not members.axial[k]:
            row[0] = 0.0
        row[1 if members.kinds[k] != "pin" else assembly.dimension :] = 0.0
    return carried


def elongations(assembly: Assembly, velocity: Floats) -> Floats:
    """Return the rates of elongation (k,) of all members, in the unit of velocities (n, q)."""
    d, centroid = assembly.dimension, assembly.elements.centroid
    rates = []
    for k in range(len(assembly.members)):
        elements, points, forces = assembly.members.push(k)
        point_velocities = velocity[elements, :d] + spun(velocity[elements, d:], points - centroid[elements])
        rates.append(float(np.einsum("ij,ij->", forces, point_velocities)))
    return np.array(rates)


def tensions(assembly: Assembly, forces: Floats) -> Floats:
    """Return the tension (k,) of all prestressed members, scene units; compression is negative."""
    members = assembly.members
    varying = members.face >= 0
    result = members.prestress.copy()
    result[varying] -= forces[members.face[varying], 0]
    return result


def effects(assembly: Assembly, forces: Floats) -> Floats:
    """Return a force per member for pictures: tension of bars, which are ties and tendons, shear of pins.

    Parameters
    ----------
    assembly : Assembly
        Structure.
    forces : (m, q) array
        Resultants, scene units.

    Returns
    -------
    (k,) array
        Force of each member, scene units.
    """
    members, forces_of_members = assembly.members, tensions(assembly, forces)
    pins = np.array([kind == "pin" for kind in members.kinds], dtype=bool)
    forces_of_members[pins] = np.linalg.norm(forces[members.face[pins], 1 : assembly.dimension], axis=1)
    return forces_of_members


def members_to_json(assembly: Assembly, forces: Floats | None, mechanism: Floats | None) -> list[dict[str, Any]]:
    # The force is positive in tension; pins also have a shear.
    members, ids = assembly.members, assembly.elements.ids
    force = None if forces is None else tensions(assembly, forces)
    rate = None if mechanism is None else elongations(assembly, mechanism)
    entries: list[dict[str, Any]] = []
    for k, name in enumerate(members.names):
        entry: dict[str, Any] = {
            "name": name,
            "kind": members.kinds[k],
            "elements": [ids[e] for e in members.elements[k]],
            "force": None if force is None else float(force[k]),
        }
        if members.kinds[k] == "pin":
            shears = slice(1, assembly.dimension)
            entry["shear"] = None if forces is None else float(np.linalg.norm(forces[members.face[k], shears]))
        entry["elongation"] = None if rate is None else float(rate[k])
        entries.append(entry)
    return entries


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
        Processor time of each part, and `total`, their sum.
    reason : str or None
        Which bound of an uncertified result is missing, and why.
    facts : dict
        Further facts of the model, as in the JSON output.
    notes : tuple of str
        Sentences about this result.
    forces, mechanism, instability_mechanism : (m, q) or (n, q) float array or None
        Of rigid elements, see `LimitAnalysisResult`; None by fields.
    """

    shown_by: ClassVar[str] = "jld_views.notebook:ResultView"

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
        """Return the least λ from which on the structure stands: 0 where it does without live load, NaN if unknown."""
        return 0.5 * sum(self.least_bracket)

    @property
    def warnings(self) -> list[str]:
        """Return the warnings about the scene and this result, one sentence each."""
        sentences = [
            *self.assembly.warnings,
            *self.assembly.notes,
            *self.notes,
            *([self.reason] if self.reason else []),
        ]
        if self.cracks == "faces" and not self.labels[: self.assembly.faces].all():
            sentences.append(BY_FACES)
        if self.stands_at_zero is False and math.isfinite(self.load_factor):
            stands_from = self.least_load_factor
            remark = "" if math.isnan(stands_from) else f"; it stands from λ = {stands_from:.6g} on"
            sentences.append(f"the structure does not stand without live load, at λ = 0{remark}")
        return sentences

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


BY_FACES: Final = (  # warning about λ of blocks with inner faces, from cracks along faces
    "λ is that of blocks that crack along the faces drawn alone; cracks elsewhere may lower it: "
    "cracks by cells or by fields tell"
)


@dataclass(frozen=True, repr=False)
class LimitAnalysisResult(Result):
    """Result of the limit analysis of one assembly of rigid elements under one labelling.

    In a notebook it shows its main values and a drawing.

    Attributes
    ----------
    forces : (m, q) float array or None
        Resultants in scene units, admissible at `bracket[0]`: planar N, V, M; spatial N, V1, V2, M1, M2, MT. The last
        rows are those of members: compression beyond the prestress, and shear of pins. Of the governing case.
    mechanism : (n, q) float array or None
        Velocities about the centroids with b_λ·u = 1, of the governing case.
    iterations : int
        Number of programs solved.
    solve_log : tuple of str
        Names of the methods tried, in order.
    model : SolveOptions
        Model and solver options.
    cases : dict of str to LimitAnalysisResult
        Result of each load case by its name; empty without load cases.
    instability_mechanism : (n, q) float array or None
        Velocities that prove that a structure is unstable; the largest displacement is 1.
    unbounded_forces : (m, q) float array or None
        Resultants per unit of λ that carry the live load of a locked structure without limit.
    all others
        As in `Result`.
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
        return self.model.contact

    @property
    def reason(self) -> str | None:  # type: ignore[override]
        """Say which bound is missing and why, or how far apart they are; None if neither."""
        return reason_of(self.status, self.bracket, self.gap, self.model.gap, self.facts) or None

    @property
    def zero_dilation(self) -> ZeroDilation | None:
        """Return the evidence for a solution without dilation; None for associative friction."""
        return ZeroDilation.of(self.facts)

    @property
    def effective_areas(self) -> EffectiveAreas | None:
        return EffectiveAreas.of(self.facts)

    def to_json(self) -> dict[str, Any]:
        """Return the object that `jld solve --json` prints."""
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
        instability = None
        if self.instability_mechanism is not None:
            instability = {name: row.tolist() for name, row in zip(ids, self.instability_mechanism, strict=True)}
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
                {"governing": self.governing, "cases": {name: result.to_json() for name, result in self.cases.items()}}
                if self.cases
                else {}
            ),
            "mechanism": mechanism,
            "instability_mechanism": instability,
            "forces": forces,
            **({"members": members_to_json(assembly, self.forces, self.mechanism)} if assembly.members else {}),
            "faces": _faces(assembly, self.labels),
        }


def _faces(assembly: Assembly, labels: Bits) -> list[dict[str, Any]]:
    """Return the JSON entries of all faces in scene units, which suffice to check equilibrium and yield by hand."""
    faces, ids = assembly.interfaces, assembly.elements.ids
    planar = assembly.dimension == 2
    entries = []
    for k in range(assembly.faces):
        frame = {"origin": faces.origin[k], "normal": faces.normal[k], "e1": faces.e1[k]}
        frame |= {} if planar else {"e2": faces.e2[k]}
        size = {"length": float(faces.l1[k])} if planar else {"area": float(faces.area[k])}
        entries.append(
            {
                "index": k,
                "elements": [ids[faces.a[k]], ids[faces.b[k]]],
                "label": "dry" if labels[k] else "inner",
                **{name: [float(value) for value in vector] for name, vector in frame.items()},
                **size,
            }
        )
    return entries


def stands_in_words(result: Result) -> str:
    """Say whether a structure stands without live load, and if not, from which λ on."""
    stands, least = result.stands_at_zero, result.least_load_factor
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


def result_of(
    template: Template, labels: Bits, options: SolveOptions, proof: Proof, *, assemble: float = 0.0, elapsed: float
) -> LimitAnalysisResult:
    """Convert a proof about the assembly of a template to a result in scene units.

    Parameters
    ----------
    template : Template
        Supplies the assembly and the scaling.
    labels : (m,) bool array
        True = dry.
    options : SolveOptions
        Options to record.
    proof : Proof
        Bounds and status, scaled.
    assemble, elapsed : float
        Seconds spent on building the analysis, and since then.

    Returns
    -------
    LimitAnalysisResult
        The result.
    """
    scaling, (low, high), status = template.scaling, proof.bracket, proof.status
    scale = load_scale(template.assembly) / scaling.load
    state, motion = proof.found or proof.state, proof.motion
    forces = None if state is None or status is Status.UNSTABLE else _scene(template, state.forces)
    has_mechanism = motion is not None and status not in (Status.UNSTABLE, Status.LOCKED)
    mechanism = element_velocities(template, motion.velocity) if motion is not None and has_mechanism else None
    width = relative_width(low, high, scale)
    unbounded = status in (Status.UNSTABLE, Status.LOCKED)
    ray = proof.ray if status is Status.LOCKED else None
    return LimitAnalysisResult(
        assembly=template.assembly,
        labels=labels,
        status=status,
        load_factor=proof.load_factor * scaling.load,
        bracket=(low * scaling.load, high * scaling.load),
        gap=math.nan if unbounded else width,
        stands_at_zero=proof.stands,
        forces=forces,
        mechanism=mechanism,
        iterations=proof.solves,
        solve_log=tuple(proof.solve_log),
        seconds={"assemble": assemble, "solve": elapsed, "total": assemble + elapsed},
        model=options,
        facts=proof.extra,
        notes=tuple(proof.notes),
        instability_mechanism=_instability_mechanism(template, proof),
        unbounded_forces=None if ray is None else _scene(template, ray.forces, ray=True),
    )


def _scene(template: Template, forces: Floats, *, ray: bool = False) -> Floats:
    """Convert resultants (m, q) to scene units, without bond unless of a ray, and without those that cannot occur."""
    assembly = template.assembly
    if ray and assembly.members.bond is not None:
        assembly = replace(assembly, members=replace(assembly.members, bond=None))
    return without_idle(assembly, forces * template.scaling.face)


def _instability_mechanism(template: Template, proof: Proof) -> Floats | None:
    """Return the velocities (n, q) that prove an instability, largest displacement or rotation 1; or None."""
    motion = proof.collapse_below_zero or proof.motion
    if proof.status is not Status.UNSTABLE or motion is None:
        return None
    velocity = element_velocities(template, motion.velocity)
    d = template.assembly.dimension
    largest = float(np.linalg.norm(velocity[:, :d], axis=1).max()) or float(abs(velocity).max())
    return velocity / largest if largest > 0.0 else None


def governing_result(assembly: Assembly, cases: dict[str, LimitAnalysisResult]) -> LimitAnalysisResult:
    """Combine the results of load cases, in their order, into that of the structure."""
    results = list(cases.values())
    bounds = [CaseBounds(result.status, *result.bracket, result.load_factor) for result in results]
    decided = governing(bounds, assembly.required.tolist())
    governing_case = results[decided.case]
    scale = max(1e-300, load_scale(governing_case.assembly) / float(assembly.required[decided.case]))
    width = relative_width(decided.low, decided.high, scale)
    stands = [result.stands_at_zero for result in results]
    # the structure stands from the largest of the least factors on
    least = np.array([result.least_bracket for result in results]) / assembly.required[:, None]
    least_bracket = (float(least[:, 0].max()), float(least[:, 1].max()))
    return replace(
        governing_case,
        assembly=assembly,
        status=decided.status,
        load_factor=decided.load_factor,
        bracket=(decided.low, decided.high),
        gap=math.nan if decided.status in (Status.UNSTABLE, Status.LOCKED) else width,
        stands_at_zero=False if False in stands else None if None in stands else True,
        iterations=sum(result.iterations for result in results),
        seconds={key: sum(result.seconds[key] for result in results) for key in governing_case.seconds},
        cases=cases,
        least_bracket=least_bracket,
        governing=list(cases)[decided.case],
    )


def element_velocities(template: Template, velocity: Floats) -> Floats:
    """Convert velocities (q·free,) of live work 1 to (n, q) in scene units with b_λ·u = 1; zero for supports."""
    assembly, scaling = template.assembly, template.scaling
    full = np.zeros((len(assembly.elements), assembly.freedoms))
    free = scaling.load * velocity / scaling.row.ravel()
    full[assembly.elements.free] = free.reshape(-1, assembly.freedoms)
    return full
