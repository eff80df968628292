"""Solve blocks whose inner faces need not yield as rigid bodies (docs/method.md (7.2)).

A block glued by inner faces that stay below yield moves as one body. The equilibrium equations of its elements are
summed. Its inner faces, and slits inside the block, are removed. The rigid λ is an upper bound: its mechanism is also a
mechanism of the full model, where all inner jumps are zero by construction.

The rigid λ is exact if every block has admissible inner forces under the boundary forces found: the full model then has
a state with the same λ. A failed check proves nothing, because boundary forces are not unique. Blocks that fail are
taken apart into their elements, and everything is solved and checked again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, Elements, blocks_of
from jld_core.geometry import spun
from jld_core.geometry.vectors import resultants
from jld_core.limit import LimitAnalysis, Motion, Proof, Status
from jld_core.limit.fallbacks import FALLBACKS
from jld_core.limit.result_building import element_velocities
from jld_core.loads import Loads
from jld_core.program import Template, beginnings, pack
from jld_core.solvers import ClarabelSolver, is_large

_STRONG = 300.0
"""Weakest inner strength over the force scale above which blocks are first solved as rigid."""

_FAILING = 0.05
"""Share of the blocks that may fail in one round where the assembly is large for its solver.

Beyond it the full model is faster. Measured on 7 140 faces, where 4 % double the time.
"""

_CRACK = 1e-4
"""Jump of an inner face, relative to the largest jump, from which a block counts as cracked by a motion."""

_ROUNDS = 4
"""Maximum number of rounds of taking blocks apart; beyond that the full model is faster."""


@dataclass(frozen=True)
class RigidBlocks:
    """Assembly of rigid blocks, with its relation to the full assembly.

    Attributes
    ----------
    assembly : Assembly
        Condensed assembly. Its element k contains the elements of the full assembly with group == k.
    group : (n,) int array
        Rigid block of each element of the full assembly.
    face : (m',) int array
        Interface of the full assembly for each interface of the condensed one.
    """

    assembly: Assembly
    group: Ints
    face: Ints


def worth_condensing(template: Template, labels: Bits) -> bool:
    """Return True if the inner faces are strong enough that rigid blocks save time.

    If strengths are of the order of the loads, most blocks fail a check and are taken apart, which costs more than
    rigid blocks save. If strengths are far above the loads, the full program is slow and badly scaled, and rigid
    blocks are exact in the first round. Measurements: docs/notes/tried.md.

    Parameters
    ----------
    template : Template
        Program template of the full assembly.
    labels : (m,) bool array
        Labels, True = dry.

    Returns
    -------
    bool
        True if the weakest inner face is stronger than a threshold, relative to the force scale. False if there
        are no inner faces.
    """
    inner = ~labels & ~template.assembly.of_members
    if not inner.any():
        return False
    # Bending counts a third of the tensile strength.
    weakest = 3.0 * template.yield_set.slack(np.zeros(template.scaling.face.shape), labels)[inner]
    return bool(weakest.min() > _STRONG)


def rigid_blocks(assembly: Assembly, labels: Bits, apart: Ints) -> RigidBlocks:
    """Join elements through inner faces into rigid blocks, except for elements in `apart`.

    Parameters
    ----------
    assembly : Assembly
        Full assembly.
    labels : (m,) bool array
        Labels, True = dry.
    apart : (k,) int array
        Elements that remain separate bodies.

    Returns
    -------
    RigidBlocks
        Condensed assembly. A block glued to a support is itself a support.
    """
    elements, faces = assembly.elements, assembly.interfaces
    alone = np.zeros(len(elements), dtype=bool)
    alone[apart] = True
    group = blocks_of(assembly, labels | alone[faces.a] | alone[faces.b])
    number = int(group.max()) + 1
    support = np.zeros(number, dtype=bool)
    np.logical_or.at(support, group, elements.support)
    acts = (group[faces.a] != group[faces.b]) & ~(support[group[faces.a]] & support[group[faces.b]])
    members = assembly.members
    for face, held in zip(members.face.tolist(), members.elements, strict=True):
        if face >= 0:
            acts[face] = len(np.unique(group[held])) > 1 and not support[group[held]].all()
    kept = np.flatnonzero(acts)
    return RigidBlocks(_joined(assembly, labels, group, support, kept), group, kept)


def _joined(assembly: Assembly, labels: Bits, group: Ints, support: Bits, kept: Ints) -> Assembly:
    """Build the condensed assembly: sum loads and weights per block, keep some interfaces.

    labels: (m,) True = dry. group: (n,) block of each element. support: (blocks,) True for supports. kept: interfaces
    that stay.
    """
    elements, faces, d = assembly.elements, assembly.interfaces, assembly.dimension
    number = len(support)
    size = np.bincount(group, minlength=number)
    centroid = np.zeros((number, d))
    np.add.at(centroid, group, elements.centroid)
    centroid /= size[:, None]
    arm = np.where(elements.support[:, None], 0.0, elements.centroid - centroid[group])

    def of_blocks(load: Floats) -> Floats:
        """Return the loads (blocks, q) of elements (n, q) on their blocks, zero on supports."""
        total = resultants(number, group, np.where(elements.support[:, None], 0.0, load), arm)
        total[support] = 0.0
        return total

    weight = np.zeros((number, d))
    np.add.at(weight, group, elements.weight)
    volume = np.bincount(group, weights=elements.volume, minlength=number).astype(float)
    order = np.argsort(group, kind="stable")
    starts = np.concatenate([[0], np.cumsum(size)])
    # Only the radius of a block is computed from its corners.
    shape = tuple(np.concatenate([elements.shape[k] for k in order[starts[g] : starts[g + 1]]]) for g in range(number))
    blocks = Elements(
        ids=tuple(f"block {g}" for g in range(number)),
        blocks=(None,) * number,
        support=support,
        centroid=centroid,
        volume=volume,
        weight=weight,
        shape=shape,
    )
    joints = replace(faces.take(kept), a=group[faces.a[kept]], b=group[faces.b[kept]])
    members, stress = assembly.members.joined(group, kept), assembly.members.self_stress
    return replace(
        assembly,
        elements=blocks,
        interfaces=joints,
        face_strengths=assembly.face_strengths.take(kept),
        dead_loads=Loads.of_resultants(of_blocks(assembly.dead)),
        live_loads=Loads.of_resultants(of_blocks(assembly.live)),
        labels=labels[kept],
        touching=(),
        members=replace(members, self_stress=None if stress is None else of_blocks(stress)),
    )


def cracked(full: LimitAnalysis, labels: Bits, velocity: Floats) -> Ints:
    """Return the elements (k,) of all blocks with an inner face that jumps in a motion.

    A jump counts above a small share of the largest. velocity: (≥ q·free,) velocities, scaled, for example multipliers
    of a solver. If they are zero or not finite, there are none. labels: (m,) True = dry.
    """
    count = full.template.matrix.shape[0]
    jumps = full.prover.jumps(velocity[None, :count])[0]
    size = abs(jumps).max(axis=1, initial=0.0)
    largest = float(size.max(initial=0.0))
    if not (np.isfinite(largest) and largest > 0.0):
        return np.zeros(0, dtype=np.int64)
    block = blocks_of(full.assembly, labels)
    open_faces = np.flatnonzero(~labels & (size > _CRACK * largest))
    return np.flatnonzero(np.isin(block, block[full.assembly.interfaces.a[open_faces]]))


def prove_condensed(full: LimitAnalysis, labels: Bits, apart: Ints | None = None) -> Proof | None:
    """Prove the load factor with rigid blocks, taking apart blocks that fail a check.

    Parameters
    ----------
    full : LimitAnalysis
        Analysis of the full model.
    labels : (m,) bool array
        Labels, True = dry.
    apart : (k,) int array, optional
        Elements that are separate bodies from the first round on, for example of blocks that are known to crack.

    Returns
    -------
    Proof or None
        Proof about the full model: its lower bound is a state checked in the full model, and its mechanism moves
        each element with its block. Its bracket may be wide, or lack the lower bound. The status may also be unstable,
        without bounds. None where the full model must be solved instead.

    Notes
    -----
    Source: docs/method.md (7.1), (7.2).
    """
    assembly, own = full.assembly, full.options
    scale = full.template.scaling
    apart = np.zeros(0, dtype=np.int64) if apart is None else apart
    route: list[str] = []
    solves = 0
    for _ in range(_ROUNDS):
        rigid = rigid_blocks(assembly, labels, apart)
        if not rigid.assembly.live.any() or not len(rigid.face):
            return None
        given = rigid.assembly.labels
        inner = LimitAnalysis(
            rigid.assembly, solver=own.solver, gap=own.gap, inner_bending=own.inner_bending, reference=given
        )
        # Where the full model is large, its own repairs take less time than a simplex on rigid blocks.
        simple = is_large(full.template.structure)
        proof = inner.prove(given, tuple(one for one in FALLBACKS if not simple or one.name != "dual simplex"))
        scaling = inner.template.scaling
        solves += proof.solves
        route += [f"rigid: {step}" for step in proof.solve_log]
        if proof.status is Status.UNSTABLE:
            # If the assembly of rigid blocks is unstable, the full model is too: cracks only add mechanisms.
            falls = proof.collapse_below_zero or proof.motion
            lifted_fall = None if falls is None else _of_elements(full, rigid, inner, falls)
            return Proof(status=Status.UNSTABLE, solve_log=route, solves=solves, collapse_below_zero=lifted_fall)
        if proof.status is not Status.COLLAPSE or proof.state is None or proof.motion is None:
            return None
        boundary = proof.state.forces * scaling.face
        load = proof.state.load * scaling.load
        found = _inner_forces(full.template, labels, rigid, boundary, load)
        solves += 1
        if found is None:
            return None
        state, failing = found
        if failing.size == 0:
            checked = full.prover.state(np.append(state.ravel(), load / scale.load), labels)
            if not (checked.admissible or boundary.any() or load):
                # Loads that cancel within each block leave its joints empty.
                inside = ~np.isin(np.arange(len(labels)), rigid.face)
                checked = full.prover.state_within(state, labels, inside)
            within = None if checked.admissible else full.repair.state(labels)
            if within is not None:
                # equilibrium of the cells has moved forces on the boundary of a yield set a last digit too far
                solves += 1
                checked = full.prover.blend(checked, within, labels)
            if not checked.admissible:
                checked = full.unloaded(labels) or checked
            lifted = Proof(solve_log=route, solves=solves, extra={"rigid_blocks": len(rigid.assembly.elements.free)})
            lifted.offer_state(checked)
            lifted.offer_motion(_of_elements(full, rigid, inner, proof.motion))
            lifted.status = full.status_of(lifted)
            return lifted if lifted.status in (Status.COLLAPSE, Status.UNCERTIFIED) else None
        if is_large(full.template.structure) and failing.size > _FAILING * len(rigid.assembly.elements):
            return None
        route.append(f"{failing.size} blocks taken apart")
        apart = np.union1d(apart, np.flatnonzero(np.isin(rigid.group, failing)))
    return None


def _inner_forces(
    template: Template, labels: Bits, rigid: RigidBlocks, boundary: Floats, load: float
) -> tuple[Floats, Ints] | None:
    """Compute scaled forces (m, q) on all faces, and list blocks without admissible ones.

    Given boundary forces and λ, each block maximises its own least slack. rigid: the condensed assembly. boundary: (m',
    q) forces on the faces between blocks, scene units. load: λ, scene units. labels: (m,) True = dry. None if the
    solver returns forces that are not finite.
    """
    scale, q, sets = template.scaling, template.assembly.freedoms, template.yield_set
    count = len(labels)
    forces = np.zeros((count, q))
    forces[rigid.face] = boundary / scale.face[rigid.face]
    faces = template.assembly.interfaces
    within = np.ones(count, dtype=bool)
    within[rigid.face] = False
    support = rigid.assembly.elements.support[rigid.group]
    within &= ~(support[faces.a] & support[faces.b])  # Faces between supports need no forces.
    inside = np.flatnonzero(within)
    if inside.size == 0:
        return forces, inside
    program = template.program(labels)
    s = program.structure
    free = template.assembly.elements.free
    # Within a block that is in balance, the equations of one element follow from those of the others. Interior points
    # take the rounding of that balance for a contradiction.
    follows = np.zeros(len(support), dtype=bool)
    follows[free[np.unique(rigid.group[free], return_index=True)[1]]] = True
    rows = np.flatnonzero(~np.repeat((support | follows)[free], q))
    columns = (q * inside[:, None] + np.arange(q)).ravel()
    pattern = sets.pattern
    extra = np.arange(pattern.extra)
    if pattern.extra:  # Append the bound on shear of each face.
        columns = np.concatenate([columns, q * count + extra[np.isin(extra, inside)]])
    matrix = program.matrix.tocsr()
    target = -(template.dead + load / scale.load * template.live) - template.matrix @ forces.ravel()
    yields = s.equalities + 1 + np.flatnonzero(within[pattern.row_face])
    linear = yields[yields < s.equalities + s.linear]
    conic = yields[yields >= s.equalities + s.linear]
    sizes = tuple(
        np.array(s.cones, dtype=np.int64)[within[_cone_faces(pattern.row_face, pattern.linear, s.cones)]].tolist()
    )
    block = rigid.group[faces.a]
    names, position = np.unique(block[inside], return_inverse=True)
    of_block = np.full(int(rigid.group.max()) + 1, -1)
    of_block[names] = np.arange(len(names))
    tips = np.concatenate([linear, conic[np.concatenate([[0], np.cumsum(sizes)])[: len(sizes)].astype(int)]])
    owner = of_block[block[pattern.row_face[tips - s.equalities - 1]]]
    slack = sp.csr_array((np.ones(len(tips)), (tips, owner)), shape=(s.shape[0], len(names)))
    wide = sp.hstack([matrix[:, columns], slack]).tocsr()
    cap = sp.hstack([sp.csr_array((len(names), len(columns))), sp.eye_array(len(names))])
    stacked = sp.vstack([wide[rows], wide[linear], cap, wide[conic]])
    rhs = np.concatenate([target[rows], program.rhs[linear], np.ones(len(names)), program.rhs[conic]])
    objective = np.concatenate([np.zeros(len(columns)), -np.ones(len(names))])
    # Far below yield slacks hardly depend on forces: without refinement of its steps the method stops short of balance.
    solver = ClarabelSolver(iterative_refinement_enable=True)
    raw = solver.solve(pack(stacked, rhs, objective, len(rows), len(linear) + len(names), sizes))
    own = raw.point[: q * inside.size].reshape(-1, q)
    if not np.all(np.isfinite(own)):
        return None
    forces[inside] = np.where(sets.active(labels)[inside], own, 0.0)
    slacks = sets.slack(forces, labels)[inside]
    return forces, names[np.unique(position[slacks < 1e-9])]


def _cone_faces(row_face: Ints, linear: int, cones: tuple[int, ...]) -> Ints:
    """Return the face of each second-order cone of a row pattern.

    row_face: (rows,) face of each row. linear: number of linear rows. cones: sizes of the cones.
    """
    return np.asarray(row_face[linear + beginnings(cones)])


def _of_elements(full: LimitAnalysis, rigid: RigidBlocks, inner: LimitAnalysis, motion: Motion) -> Motion:
    """Convert a motion of rigid blocks into a motion of the elements of the full model.

    Faces inside a block do not jump. inner: the analysis of the rigid blocks.
    """
    assembly, scale = full.assembly, full.template.scaling
    mechanism = element_velocities(inner.template, motion.velocity)[rigid.group]
    arm = assembly.elements.centroid - rigid.assembly.elements.centroid[rigid.group]
    d = assembly.dimension
    mechanism[:, :d] += spun(mechanism[:, d:], arm)
    velocity = (mechanism[assembly.elements.free] * scale.row.reshape(-1, assembly.freedoms)).ravel() / scale.load
    jumps = np.zeros(scale.face.shape)
    jumps[rigid.face] = (full.prover.transposed @ velocity).reshape(scale.face.shape)[rigid.face]
    unit = inner.template.scaling.load / scale.load
    return Motion(velocity, jumps, 1.0, motion.margin, motion.bound * unit, motion.noise * unit)
