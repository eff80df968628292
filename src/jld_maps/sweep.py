"""Load factors of a structure over a grid of values."""

from __future__ import annotations

import itertools
import shutil
import tempfile
from inspect import Parameter, signature
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from jld_core import (
    FACTS,
    Assembly,
    Bits,
    Floats,
    Model,
    Route,
    Scene,
    Status,
    Strengths,
    build_assembly,
    load_scene,
    one_thread,
    solve,
)
from jld_core import assembly as assemblies
from jld_core.limit import CaseBounds, SampleAnalysis, face_jumps, governing, movements
from jld_core.mechanics import equilibrium_matrix, require_materials
from jld_core.models import CaseAnalysis, limit_analysis
from jld_explore import explore as search
from jld_maps.grid import Grid, States, points_of
from jld_maps.kinds import mechanism_names

_ROUTE: Final = Route("maps", frozenset(FACTS))
_OPTIONS: Final = Model(cracks="faces")
_PORTION: Final = 4096  # points that are solved together
_BOUNDS: Final = ("status", "bracket_lo", "bracket_hi")
_STARTS: Final = 4  # starting points of the batch solver
_FEW: Final = 16  # points that are solved one by one rather than from another starting point
_DECIDED: Final = (Status.COLLAPSE, Status.LOCKED, Status.UNSTABLE)


def sweep(
    structure: Any,
    grid: Any,
    labels: Any = None,
    explore: bool = False,
    jobs: int = 1,
    *,
    fields: bool = False,
    seconds: float | None = None,
) -> pd.DataFrame:
    """Compute λ over a grid, see `jld_explore.sweep`."""
    axes = points_of(grid)
    points = None
    if not callable(structure):
        points = Grid(structure if isinstance(structure, Scene) else load_scene(structure), axes)
        axes = points.axes
    places = np.array(list(itertools.product(*(range(len(one)) for one in axes.values()))))
    columns = zip(axes.items(), places.T.tolist(), strict=True)
    table = pd.DataFrame({key: [values[k] for k in column] for (key, values), column in columns})
    one_by_one = delayed(_best if explore else _solved)
    if points is None:
        points_in = [{str(key): value for key, value in row.items()} for row in table.to_dict("records")]
        # a function of one parameter with another name than the keys takes a point as a dict
        named = list(signature(structure).parameters.values())
        whole = len(named) == 1 and named[0].name not in axes and named[0].kind is not Parameter.VAR_KEYWORD
        made = [structure(row) if whole else structure(**row) for row in points_in]
        rows = Parallel(n_jobs=jobs)(one_by_one(one, labels, fields, seconds) for one in made)
        return table.assign(**pd.DataFrame(rows))
    states = None if explore else points.states()
    swept = None if states is None else Swept(points, states, labels)
    if swept is None or not swept.batched:
        rows = Parallel(n_jobs=jobs)(one_by_one(points.scene(row), labels, fields, seconds) for row in places)
        return table.assign(**pd.DataFrame(rows))
    table = table.assign(**swept.all(places, jobs))
    if fields:
        more = Parallel(n_jobs=jobs)(delayed(_by_fields)(points.assembly(row), labels, seconds) for row in places)
        table = table.assign(**pd.DataFrame(more))
    return table


def _uncut(assembly: Assembly, labels: Bits) -> Bits:
    """Return labels (m,) of which all faces that may be inner are: those between free elements with inner strength."""
    tension = assembly.strengths(_ROUTE).tension
    return labels & ~(assembly.free_faces & ~np.isnan(tension))


def _solved(structure: Any, labels: Any, fields: bool, seconds: float | None) -> dict[str, Any]:
    """Return the columns of one point, solved alone."""
    assembly = structure if isinstance(structure, Assembly) else build_assembly(structure)
    own = assemblies.labels_of(assembly, labels)
    found = solve(assembly, own)
    row = _row(found) | {"uncut": found.bracket[1]}
    whole = _uncut(assembly, own)
    if (whole != own).any():
        row["uncut"] = solve(assembly, whole).bracket[1]
    return row | (_by_fields(assembly, own, seconds) if fields else {})


def _row(found: Any) -> dict[str, Any]:
    """Return the columns of a result."""
    name = ""
    if found.status is Status.COLLAPSE and found.mechanism is not None:
        jumps = face_jumps(found.assembly, found.mechanism)[None]
        friction = np.nan_to_num(found.assembly.strengths(_ROUTE).friction)
        kinds = movements(found.assembly, found.labels, jumps, friction)[0]
        name = mechanism_names(found.assembly, found.labels, kinds)[0]
    return {
        "load_factor": found.load_factor,
        "bracket_lo": found.bracket[0],
        "bracket_hi": found.bracket[1],
        "status": str(found.status),
        "mechanism": name,
        "proven": found.status in _DECIDED,
    }


def _by_fields(assembly: Assembly, labels: Any, seconds: float | None) -> dict[str, float]:
    found = solve(assembly, labels, cracks="fields", seconds=seconds)
    return {"fields_lo": found.bracket[0], "fields_hi": found.bracket[1]}


def _best(structure: Any, labels: Any, fields: bool, seconds: float | None) -> dict[str, Any]:
    """Return the columns of the strongest layout at one point."""
    folder = Path(tempfile.mkdtemp(prefix="jld-map-"))
    try:
        done = search(structure, folder / "search", pictures=False, seconds=seconds)
        facts, best = done.summary, done.result(1) if done.summary.best is not None else None
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    numbers = dict.fromkeys(("load_factor", "bracket_lo", "bracket_hi"), np.nan)
    row = {**numbers, "status": "unstable", "mechanism": ""} if best is None else _row(best)
    assembly = build_assembly(structure)
    whole = solve(assembly, _uncut(assembly, assembly.labels)).bracket[1]
    row |= {"proven": bool(facts.proven), "uncut": whole, "labelling": facts.best_labelling}
    if fields:
        row["fields_lo"], row["fields_hi"] = facts.by_fields or (np.nan, np.nan)
    return row


class Swept:
    """Bounds at all points of a grid on whose values only strengths and loads depend, by the batch solver."""

    def __init__(self, points: Grid, states: States, labels: Any, *, uncut: bool = True) -> None:
        self.points, self.states, self.assembly = points, states, points.assembly(points.middle)
        self.labels = assemblies.labels_of(self.assembly, labels)
        require_materials(self.assembly, self.labels, ~self.labels)
        whole = _uncut(self.assembly, self.labels) if uncut else self.labels
        self._whole = None if (whole == self.labels).all() else whole
        each = {one.tobytes(): one for one in (self.labels, whole)}
        self._usual = {key: self._analyses(self.assembly, one) for key, one in each.items()}
        self.batched = all(one.batched for each in self._usual.values() for one in each)

    @staticmethod
    def _analyses(assembly: Assembly, labels: Bits) -> list[SampleAnalysis]:
        return [SampleAnalysis(limit_analysis(case, _OPTIONS, reference=labels), labels) for case in assembly.by_case]

    def all(self, places: Floats, jobs: int) -> dict[str, Any]:
        """Return the columns of all points (k, axes)."""
        size = min(_PORTION, -(-len(places) // jobs))
        portions = [places[k : k + size] for k in range(0, len(places), size)]
        parts = Parallel(n_jobs=jobs, prefer="threads")(delayed(self._portion)(one) for one in portions)
        return {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}

    @one_thread()
    def _portion(self, places: Floats) -> dict[str, Any]:
        """Return the columns of some points (k, axes)."""
        found = self._bounds(places, self.labels)
        whole = found if self._whole is None else self._bounds(places, self._whole, named=False)
        return found | {"uncut": np.where(np.isfinite(whole["bracket_hi"]), whole["bracket_hi"], np.nan)}

    def _bounds(self, places: Floats, labels: Bits, *, named: bool = True) -> dict[str, Any]:
        """Return the columns of some points (k, axes)."""
        analyses, left = self._usual[labels.tobytes()], np.arange(len(places))
        found: dict[str, Any] = {}
        for _ in range(_STARTS):
            strengths, loads = self.states.at(places[left])
            each = zip(analyses, loads, strict=True)
            again = self._governing([self._case(one, strengths, own, labels, named=named) for one, own in each])
            # strengths that only a scene can refuse
            refused = strengths.tension * strengths.inner_friction > strengths.shear * (1 + 1e-12)
            again["status"][refused.reshape(len(left), -1).any(axis=1)] = ""
            for name, values in again.items():
                found.setdefault(name, values)[left] = values
            left = left[again["status"] == ""]
            if len(left) < _FEW:
                break
            # a starting point among those that are left
            analyses = self._analyses(self.points.assembly(places[left[len(left) // 2]]), labels)
        for k in left.tolist():
            alone = CaseAnalysis(self.points.assembly(places[k]), _OPTIONS, single_labelling=True).solve(labels)
            for name, value in _row(alone).items():
                found[name][k] = value
        return found

    def _case(
        self, one: SampleAnalysis, strengths: Strengths, loads: Floats, labels: Bits, *, named: bool
    ) -> dict[str, Any]:
        """Return the columns of k points under one load case; status "" where it is open. loads: (2, k, n, q)."""
        found = one.solve(strengths, *loads, vectors=named)
        bounds, scaling = one.bounds(found), one.analysis.template.scaling
        columns: dict[str, Any] = {
            "status": np.array([str(bounds.status(k) or "") for k in range(len(found.low))], dtype=object),
            "bracket_lo": scaling.load * bounds.low,
            "bracket_hi": scaling.load * bounds.high,
            "mechanism": np.full(len(found.low), "", dtype=object),
        }
        falls = np.flatnonzero(columns["status"] == str(Status.COLLAPSE)) if named else np.zeros(0, dtype=np.int64)
        if len(falls):
            velocity = found.velocities[falls] / scaling.row.ravel()
            jumps = (equilibrium_matrix(self.assembly).T @ velocity.T).T.reshape(len(falls), len(labels), -1)
            friction = np.nan_to_num(strengths.friction.reshape(-1, len(labels))[falls])
            kinds = movements(self.assembly, labels, jumps, friction)[0]
            columns["mechanism"][falls] = mechanism_names(self.assembly, labels, kinds)
        return columns

    def _governing(self, cases: list[dict[str, Any]]) -> dict[str, Any]:
        """Combine the columns of load cases."""
        found = cases[0]
        if self.assembly.cases:
            required = self.assembly.required.tolist()
            known = [
                [CaseBounds(Status(s or "uncertified"), lo, hi, 0.5 * (lo + hi)) for s, lo, hi in row]
                for row in zip(*(zip(*(one[name] for name in _BOUNDS), strict=True) for one in cases), strict=True)
            ]
            decided = [governing(row, required) for row in known]
            found = {
                "status": np.array([str(one.status).replace("uncertified", "") for one in decided], dtype=object),
                "bracket_lo": np.array([one.low for one in decided]),
                "bracket_hi": np.array([one.high for one in decided]),
                "mechanism": np.array([cases[one.case]["mechanism"][k] for k, one in enumerate(decided)], dtype=object),
            }
        value = 0.5 * (found["bracket_lo"] + found["bracket_hi"])
        proven = np.isin(found["status"].astype(str), [str(one) for one in _DECIDED])
        return {"load_factor": value, **found, "proven": proven}
