"""Crack on demand: blocks whose inner faces need not yield are solved as rigid bodies (docs/method.md (7.2)).

A block glued by inner faces that stay below yield moves as one body: its elements' equilibrium is summed and
its inner faces, and slits within it, drop out. The rigid λ is an upper bound, and its mechanism is one of the full
model, inner jumps being zero by construction. Where admissible inner forces exist in every block under the
boundary forces found, the rigid λ is exact: the full model has a state with the same λ. Where they do not, that
proves nothing, since boundary forces are not unique: those blocks are taken apart, and everything is solved and
checked again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Floats, Ints
from jld_core.assembly import Assembly, Elements, blocks_of
from jld_core.geometry import moment_about, spun
from jld_core.limit import LimitAnalysis, Motion, Proof, Status, element_velocities
from jld_core.program import Template, beginnings, pack
from jld_core.solvers import ClarabelSolver, is_large

_STRONG = 300.0  # strength over force scale above which blocks count as rigid until shown otherwise
_STRONG_LARGE = 4.0  # the same for assemblies that are large for their solver (measured on 2 025 faces)
_ROUNDS = 4  # rounds of taking blocks apart before the full model is the shorter way


@dataclass(frozen=True)
class RigidBlocks:
    """An assembly whose elements are blocks.

    assembly: the condensed one; element k holds the elements with group == k. group: (n,). face: (m',) the
    full assembly's interface of each of its interfaces.
    """

    assembly: Assembly
    group: Ints
    face: Ints


def worth_condensing(template: Template, labels: Bits) -> bool:
    """Are the inner faces so strong that they are better left out? Measured in benchmarks/condensation.py.

    With strengths of the order of the loads most blocks fail some check and are taken apart, which costs more
    than it saves; far above them the full program is slow and badly scaled, and rigid blocks are exact at once.
    """
    strengths, area = template.assembly.strengths, template.assembly.interfaces.area
    inner = ~labels
    if not inner.any():
        return False
    weakest = np.minimum(strengths.tension, strengths.shear)[inner] * area[inner] / template.scaling.force
    return bool(np.nanmin(weakest) > (_STRONG_LARGE if is_large(template.structure) else _STRONG))


def rigid_blocks(assembly: Assembly, labels: Bits, apart: Ints) -> RigidBlocks:
    """Join elements through inner faces, except within blocks that are taken apart.

    labels: (m,) True dry. apart: elements that stand for themselves. A block glued to a support is support.
    """
    elements, faces = assembly.elements, assembly.interfaces
    alone = np.zeros(len(elements), dtype=bool)
    alone[apart] = True
    group = blocks_of(assembly, labels | alone[faces.a] | alone[faces.b])
    number = int(group.max()) + 1
    support = np.zeros(number, dtype=bool)
    np.logical_or.at(support, group, elements.support)
    kept = np.flatnonzero((group[faces.a] != group[faces.b]) & ~(support[group[faces.a]] & support[group[faces.b]]))
    return RigidBlocks(_joined(assembly, labels, group, support, kept), group, kept)


def _joined(assembly: Assembly, labels: Bits, group: Ints, support: Bits, kept: Ints) -> Assembly:
    elements, faces, s, d = assembly.elements, assembly.interfaces, assembly.strengths, assembly.dimension
    number = len(support)
    size = np.bincount(group, minlength=number)
    centroid = np.zeros((number, d))
    np.add.at(centroid, group, elements.centroid)
    centroid /= size[:, None]
    moved = []
    for load in (assembly.dead, assembly.live):
        arm = elements.centroid - centroid[group]
        own = load.copy()
        own[:, d:] += moment_about(arm, load[:, :d])
        own[elements.support] = 0.0
        total = np.zeros((number, load.shape[1]))
        np.add.at(total, group, own)
        total[support] = 0.0
        moved.append(total)
    weight = np.zeros((number, d))
    np.add.at(weight, group, elements.weight)
    volume = np.bincount(group, weights=elements.volume, minlength=number).astype(float)
    order = np.argsort(group, kind="stable")
    starts = np.concatenate([[0], np.cumsum(size)])
    # corners are kept for the radius of the block only
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
    strengths = s.take(kept)
    return replace(
        assembly,
        elements=blocks,
        interfaces=joints,
        strengths=strengths,
        dead=moved[0],
        live=moved[1],
        labels=labels[kept],
        live_points=(),
        touching=(),
    )


def prove_condensed(full: LimitAnalysis, labels: Bits) -> Proof | None:
    """Proof by rigid blocks, cracked on demand; None where the full model is the way to go.

    full: of the full model. labels: (m,) True dry. The proof is one of the full model: the lower end is a state of
    it, checked as such, and the mechanism moves each element with its block.
    Source: docs/method.md (7.1), (7.2).
    """
    assembly, own = full.assembly, full.options
    scale = full.template.scaling
    apart = np.zeros(0, dtype=np.int64)
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
        proof, scaling = inner.prove(given), inner.template.scaling
        solves += proof.solves
        route += [f"rigid: {step}" for step in proof.route]
        if proof.status is Status.UNSTABLE:
            # rigid blocks that cannot stand cannot stand if they may crack besides
            return Proof(status=Status.UNSTABLE, route=route, solves=solves)
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
            if not checked.admissible:
                checked = full.unloaded(labels) or checked
            lifted = Proof(route=route, solves=solves, extra={"rigid_blocks": len(rigid.assembly.elements.free)})
            lifted.offer_state(checked)
            lifted.offer_motion(_of_elements(full, rigid, inner, proof.motion))
            lifted.status = full.judge(lifted)
            return lifted if lifted.status is Status.COLLAPSE else None
        route.append(f"{failing.size} blocks taken apart")
        apart = np.union1d(apart, np.flatnonzero(np.isin(rigid.group, failing)))
    return None


def _inner_forces(
    template: Template, labels: Bits, rigid: RigidBlocks, boundary: Floats, load: float
) -> tuple[Floats, Ints] | None:
    """Scaled forces on all faces, and the blocks for which no admissible inner forces were found.

    boundary: (m', q) forces on the faces between blocks, scene units; load: λ, scene units. Each block looks
    for the state of largest slack of its own; blocks decouple once boundary forces and λ are given.
    """
    scale, q, sets = template.scaling, template.assembly.freedoms, template.yield_set
    count = len(labels)
    forces = np.zeros((count, q))
    forces[rigid.face] = boundary / scale.face[rigid.face]
    faces = template.assembly.interfaces
    within = np.ones(count, dtype=bool)
    within[rigid.face] = False
    support = rigid.assembly.elements.support[rigid.group]
    within &= ~(support[faces.a] & support[faces.b])  # between glued supports nothing is asked for
    inside = np.flatnonzero(within)
    if inside.size == 0:
        return forces, inside
    program = template.program(labels)
    s = program.structure
    free = template.assembly.elements.free
    rows = np.flatnonzero(~np.repeat(support[free], q))
    columns = (q * inside[:, None] + np.arange(q)).ravel()
    pattern = sets.pattern
    extra = np.arange(pattern.extra)
    if pattern.extra:  # one bound on shear per face
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
    raw = ClarabelSolver().solve(pack(stacked, rhs, objective, len(rows), len(linear) + len(names), sizes))
    own = raw.point[: q * inside.size].reshape(-1, q)
    if not np.all(np.isfinite(own)):
        return None
    forces[inside] = np.where(sets.active(labels)[inside], own, 0.0)
    room = sets.slack(forces, labels)[inside]
    return forces, names[np.unique(position[room < 1e-9])]


def _cone_faces(row_face: Ints, linear: int, cones: tuple[int, ...]) -> Ints:
    return np.asarray(row_face[linear + beginnings(cones)])


def _of_elements(full: LimitAnalysis, rigid: RigidBlocks, inner: LimitAnalysis, motion: Motion) -> Motion:
    """A motion of rigid blocks as one of the full model: each element moves with its block, no face within one jumps.

    inner: the analysis of the rigid blocks.
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
