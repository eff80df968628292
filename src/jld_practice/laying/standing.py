"""Stability of stages under self-weight, and the least prop forces otherwise, by conic programs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from jld_core import Assembly, Bits, Bools, Floats, Ints, checkpoint
from jld_core.geometry import moment_about
from jld_core.program import ConicProgram, Template, beginnings, pack
from jld_core.solvers import solve_auxiliary
from jld_practice.laying.freedom import Blocks, Stations

# Prop force, relative to the laid weight, below which a prop is zero; also the accepted solver error. A stage stands up
# to ten times this force.
_NONE: Final = 1e-6


_ELSEWHERE: Final = 100.0  # cost of a prop beside the places of a line of props, relative to one of these places


@dataclass(frozen=True)
class Stage:
    """Stability of one stage of an assembly sequence under self-weight."""

    props: Floats  # (k,) upward force on each block, scene units, 0 where none is needed
    error: float  # largest of the residuals of equations and yield rows and of the duality gap, relative to the weight
    weight: float  # laid weight, force
    # (s,) force at each place of props along a line, contained in `props`; empty without such a line
    along: Floats = field(default_factory=lambda: np.zeros(0))
    places: Floats = field(default_factory=lambda: np.zeros((0, 2)))  # (s, 2) these places, scene units

    @property
    def elsewhere(self) -> float:
        """Sum of props beside the places of a line of props, force."""
        return float(self.props.sum() - self.along.sum()) if self.along.size else 0.0

    @property
    def stands(self) -> bool | None:
        """Whether the stage stands without props; None if it was not solved."""
        if not self.error <= _NONE:
            return None
        return bool(self.props.sum() <= 10.0 * _NONE * self.weight)


@dataclass(frozen=True)
class _Part:
    """Prop forces of one part of a stage; error, weight and along are as in `Stage`."""

    props: Floats  # (n,) upward force on each element
    error: float
    weight: float
    along: Floats


class Standing:
    """Solved stages of one labelling, stored by the set of laid blocks."""

    def __init__(self, blocks: Blocks, labels: Bits, parts: Parts | None = None) -> None:
        self.blocks, self.labels = blocks, np.asarray(labels, dtype=bool)
        self.parts = Parts(blocks.assembly) if parts is None else parts
        self._stages: dict[bytes, Stage] = {}

    def stage(self, laid: Bools) -> Stage:
        """Return the stability of the stage in which blocks `laid` (k,), and the fixed ones, are laid."""
        laid = laid | self.blocks.fixed
        key = np.packbits(laid).tobytes()
        if key not in self._stages:
            parts = self.parts.of(laid[self.blocks.of], self.labels)
            props = np.zeros(len(self.blocks))
            for part in parts:
                np.add.at(props, self.blocks.of, part.props)
            error = max((part.error for part in parts), default=0.0)
            along = np.zeros(self.parts.places)
            for part in parts:
                along += part.along
            weight, stations = sum(part.weight for part in parts), self.parts.stations
            if stations is None:
                self._stages[key] = Stage(props, error, weight)
            else:
                self._stages[key] = Stage(props, error, weight, along, stations.points)
        return self._stages[key]


class Parts:
    """Store of solved parts of stages, shared by all labellings of one assembly."""

    def __init__(self, assembly: Assembly, stations: Stations | None = None) -> None:
        # Laid elements that touch form a part, apart from supports. Its props depend on its elements and the labels
        # between them alone. They stand beside `stations` only where these cannot hold a stage, or a hundredth of the
        # force suffices.
        self.assembly, self.stations = assembly, stations
        self._parts: dict[bytes, _Part] = {}

    @property
    def places(self) -> int:
        """Number of places of props along a line, 0 without one."""
        return 0 if self.stations is None else len(self.stations.element)

    @cached_property
    def template(self) -> Template:
        """Program of the first load case; its loads are not used."""
        return Template(self.assembly.by_case[0])

    def of(self, laid: Bools, labels: Bits) -> list[_Part]:
        """Return the props of each part of the stage of elements `laid` (n,), solved or from the store."""
        faces, support = self.assembly.interfaces, self.assembly.elements.support
        free = laid & ~support
        joined = np.flatnonzero(free[faces.a] & free[faces.b])
        ends, count = (faces.a[joined], faces.b[joined]), len(laid)
        link = sp.coo_array((np.ones(len(joined)), ends), shape=(count, count))
        name = connected_components(link, directed=False)[1]
        return [self._part(laid & (support | (name == part)), labels) for part in np.unique(name[free])]

    def _part(self, laid: Bools, labels: Bits) -> _Part:
        """Return the least props of a stage of laying, computed once."""
        faces = self.assembly.interfaces
        key = np.packbits(laid).tobytes() + np.packbits(labels[laid[faces.a] & laid[faces.b]]).tobytes()
        if key not in self._parts:
            checkpoint()
            self._parts[key] = self._least_props(laid, labels)
        return self._parts[key]

    def _least_props(self, laid: Bools, labels: Bits) -> _Part:
        """Minimise the sum of prop forces of the part of elements `laid` (n,)."""
        assembly, template = self.assembly, self.template
        elements, faces, q = assembly.elements, assembly.interfaces, assembly.freedoms
        props = np.zeros(len(laid))
        free = elements.free
        standing = np.flatnonzero(laid[free])
        weight = float(np.linalg.norm(elements.weight[free[standing]], axis=1).sum())
        if weight == 0.0:
            return _Part(props, 0.0, weight, np.zeros(self.places))
        program = template.program(labels)
        weights = np.zeros((len(free), q))
        weights[:, : assembly.dimension] = elements.weight[free]
        weight_of = (weights / template.scaling.row).ravel()
        # rows of the limit analysis: equations of laid elements, yield rows of faces between them; without λ
        chosen = laid[faces.a] & laid[faces.b]
        pattern = template.yield_set.pattern
        equations = (q * standing[:, None] + np.arange(q)).ravel()
        first = template.structure.equalities + 1
        linear = first + np.flatnonzero(chosen[pattern.row_face[: pattern.linear]])
        heads = pattern.linear + beginnings(pattern.cones)
        cones_kept = [k for k in range(len(pattern.cones)) if chosen[pattern.row_face[heads[k]]]]
        conic = [first + heads[k] + np.arange(pattern.cones[k]) for k in cones_kept]
        yields = np.concatenate([linear, *conic]) if conic else linear
        matrix = program.matrix.tocsr()
        of_yield, of_equations = matrix[yields], matrix[equations]
        used = np.flatnonzero(np.diff(of_yield.tocsc().indptr))
        used = used[used < matrix.shape[1] - 1]
        # further columns: prop forces, at least 0, whose sum is least
        push, owner, station = self._props(standing)
        prop_count = push.shape[1]
        forces = sp.vstack([of_equations[:, used], sp.csr_array((prop_count, len(used))), of_yield[:, used]])
        upward = sp.vstack([sp.csr_array(push), -sp.eye_array(prop_count), sp.csr_array((len(yields), prop_count))])
        rows = sp.hstack([forces, upward])
        rhs = np.concatenate([-weight_of[equations], np.zeros(prop_count), program.rhs[yields]])
        cost = np.where(station < 0, 1.0 if self.stations is None else _ELSEWHERE, 1.0)
        objective = np.concatenate([np.zeros(len(used)), cost])
        cones = tuple(pattern.cones[k] for k in cones_kept)
        problem = pack(rows, rhs, objective, len(equations), prop_count + len(linear), cones)
        answer = solve_auxiliary(problem)
        error = _error(problem, answer.point, answer.dual)
        force = np.maximum(answer.point[len(used) :], 0.0) * template.scaling.force
        force = np.where(force > _NONE * weight / prop_count, force, 0.0)
        np.add.at(props, owner, force)
        along = np.zeros(self.places)
        np.add.at(along, station[station >= 0], force[station >= 0])
        relative = template.scaling.force / weight
        return _Part(np.where(props > _NONE * weight, props, 0.0), error * relative, weight, along)

    def _props(self, standing: Ints) -> tuple[Floats, Ints, Ints]:
        """Return unit prop forces (q·k, props), and element and place (props,) of each."""
        # standing: (k,) laid elements among the free ones. A place is the number of a station, −1 elsewhere.
        assembly, template = self.assembly, self.template
        elements, q, d = assembly.elements, assembly.freedoms, assembly.dimension
        total = elements.weight[elements.free].sum(axis=0)
        up = -total / np.linalg.norm(total)
        across = np.eye(d) - np.outer(up, up)
        sides = across[np.argsort(-np.linalg.norm(across, axis=1))[: d - 1]]
        columns, owner, positions = [], [], []
        for position, row in enumerate(standing.tolist()):
            element = int(elements.free[row])
            points, stations_of = [elements.centroid[element]], [-1]
            if self.stations is not None:
                stations = np.flatnonzero(self.stations.element == element)
                points += list(self.stations.points[stations])
                stations_of += stations.tolist()
            for side in sides:
                along = elements.shape[element] @ side
                points += [
                    elements.shape[element][int(np.argmin(along))],
                    elements.shape[element][int(np.argmax(along))],
                ]
            stations_of += [-1] * (len(points) - len(stations_of))
            for point, station in zip(points, stations_of, strict=True):
                arm = point - elements.centroid[element]
                column = np.zeros(q * len(standing))
                column[q * position : q * (position + 1)] = (
                    np.concatenate([up, moment_about(arm, up)]) * template.scaling.force / template.scaling.row[row]
                )
                columns.append(column)
                owner.append(element)
                positions.append(station)
        return np.array(columns).T, np.array(owner, dtype=np.int64), np.array(positions, dtype=np.int64)


def _error(program: ConicProgram, point: Floats, dual: Floats) -> float:
    """Return the largest violation of primal and dual rows, and the duality gap, of a solution."""
    # computed anew, whatever the solver says
    if not (np.isfinite(point).all() and np.isfinite(dual).all()):
        return np.inf
    structure = program.structure
    slack = program.rhs - program.matrix @ point
    equal, end = structure.equalities, structure.equalities + structure.linear
    worst = float(abs(slack[:equal]).max(initial=0.0))
    worst = max(worst, float((-slack[equal:end]).max(initial=0.0)), float((-dual[equal:end]).max(initial=0.0)))
    start = end
    for size in structure.cones:
        for part in (slack[start : start + size], dual[start : start + size]):
            worst = max(worst, float(np.linalg.norm(part[1:]) - part[0]))
        start += size
    error = program.objective + program.matrix.T @ dual
    worst = max(worst, float(abs(error).max(initial=0.0)))
    return max(worst, abs(float(program.objective @ point + program.rhs @ dual)))
