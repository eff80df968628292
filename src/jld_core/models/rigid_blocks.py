"""Solve blocks whose inner faces need not yield as rigid bodies (docs/method.md (7.2)).

A failed check proves nothing: blocks that fail are taken apart into their elements, and everything is solved again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, cast

import numpy as np
import scipy.sparse as sp

from jld_core import tolerances
from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import DRY, INNER, Assembly, Elements, blocks_of, without
from jld_core.errors import ParameterError, SolverError
from jld_core.geometry import spun
from jld_core.geometry.vectors import resultants
from jld_core.limit import Motion, Proof, State
from jld_core.limit.analysis import FALLBACKS, Fallback, LimitAnalysis, ProofAttempt, insert_before
from jld_core.limit.options import Model, Status
from jld_core.limit.result import element_velocities
from jld_core.linalg import components
from jld_core.loads import Loads
from jld_core.mechanics.standard import local_hulls
from jld_core.models.effective_area import prove_effective_area, require_rectangles
from jld_core.plugins import part
from jld_core.program import Template, beginnings, pack
from jld_core.solvers import ClarabelSolver, RawStatus, is_large
from jld_core.strengths import ADHESION, STANDARD, Route

_STRONG = 300.0  # weakest inner strength over the force scale above which blocks are first solved as rigid

# Share of the blocks that may fail in one round where the assembly is large for its solver. Beyond it the full model is
# faster. Measured on 7 140 faces, where 4 % double the time.
_FAILING = 0.05

_CRACK = 1e-4  # jump of an inner face, relative to the largest jump, from which a block counts as cracked by a motion

_ROUNDS = 4  # maximum number of rounds of taking blocks apart; beyond that the full model is faster


@dataclass(frozen=True)
class RigidBlocks:
    """Assembly of rigid blocks, with its relation to the full assembly."""

    assembly: Assembly  # condensed assembly. Its element k contains the elements of the full assembly with group == k.
    group: Ints  # (n,) rigid block of each element of the full assembly
    face: Ints  # (m',) interface of the full assembly for each interface of the condensed one


def worth_condensing(template: Template, labels: Bits) -> bool:
    """Return True if the weakest inner face is so strong that rigid blocks save time; False without inner faces."""
    # Where strengths are of the order of loads, most blocks fail a check and are taken apart, which costs more than
    # rigid blocks save. Far above, the full program is slow and badly scaled, and rigid blocks are exact at once
    # (docs/notes/tried.md).
    inner = ~labels & ~template.assembly.of_members
    if not inner.any():
        return False
    # Bending counts a third of the tensile strength.
    weakest = 3.0 * template.yield_set.slack(np.zeros(template.scaling.face.shape), labels)[inner]
    return bool(weakest.min() > _STRONG)


def rigid_blocks(assembly: Assembly, labels: Bits, separate: Ints) -> RigidBlocks:
    """Join elements through inner faces into rigid blocks, also with supports, except those of `separate` (k,)."""
    elements, faces = assembly.elements, assembly.interfaces
    is_separate = np.zeros(len(elements), dtype=bool)
    is_separate[separate] = True
    group = blocks_of(assembly, labels | is_separate[faces.a] | is_separate[faces.b])
    count = int(group.max()) + 1
    support = np.zeros(count, dtype=bool)
    np.logical_or.at(support, group, elements.support)
    is_joint = (group[faces.a] != group[faces.b]) & ~(support[group[faces.a]] & support[group[faces.b]])
    members = assembly.members
    for face, owners in zip(members.face.tolist(), members.elements, strict=True):
        if face >= 0:
            is_joint[face] = len(np.unique(group[owners])) > 1 and not support[group[owners]].all()
    joint_faces = np.flatnonzero(is_joint)
    return RigidBlocks(_condense(assembly, labels, group, support, joint_faces), group, joint_faces)


def _condense(assembly: Assembly, labels: Bits, group: Ints, support: Bits, joint_faces: Ints) -> Assembly:
    """Build the condensed assembly: sum loads and weights per block `group` (n,), keep some interfaces."""
    elements, faces, d = assembly.elements, assembly.interfaces, assembly.dimension
    count = len(support)
    size = np.bincount(group, minlength=count)
    centroid = np.zeros((count, d))
    np.add.at(centroid, group, elements.centroid)
    centroid /= size[:, None]
    arm = np.where(elements.support[:, None], 0.0, elements.centroid - centroid[group])

    def of_blocks(load: Floats) -> Floats:
        """Return the loads (blocks, q) of elements (n, q) on their blocks, zero on supports."""
        total = resultants(count, group, np.where(elements.support[:, None], 0.0, load), arm)
        total[support] = 0.0
        return total

    weight = np.zeros((count, d))
    np.add.at(weight, group, elements.weight)
    volume = np.bincount(group, weights=elements.volume, minlength=count).astype(float)
    order = np.argsort(group, kind="stable")
    starts = np.concatenate([[0], np.cumsum(size)])
    # Only the radius of a block is computed from its corners.
    shape = tuple(np.concatenate([elements.shape[k] for k in order[starts[g] : starts[g + 1]]]) for g in range(count))
    blocks = Elements(
        ids=tuple(f"block {g}" for g in range(count)),
        blocks=(None,) * count,
        support=support,
        centroid=centroid,
        volume=volume,
        weight=weight,
        shape=shape,
    )
    joints = replace(faces.take(joint_faces), a=group[faces.a[joint_faces]], b=group[faces.b[joint_faces]])
    members, self_stress = assembly.members.joined(group, joint_faces), assembly.members.self_stress
    stated = assembly.dead if self_stress is None else assembly.dead - self_stress  # blocks add their self-stress again
    return replace(
        assembly,
        elements=blocks,
        interfaces=joints,
        face_strengths=assembly.face_strengths.take(joint_faces),
        dead_loads=Loads.of_resultants(of_blocks(stated)),
        live_loads=Loads.of_resultants(of_blocks(assembly.live)),
        labels=labels[joint_faces],
        touching=(),
        members=replace(members, self_stress=None if self_stress is None else of_blocks(self_stress)),
    )


def cracked(full: LimitAnalysis, labels: Bits, velocity: Floats) -> Ints:
    """Return the elements (k,) of all blocks with an inner face that jumps in a motion."""
    # A jump counts above a small share of the largest.
    count = full.template.matrix.shape[0]
    jumps = full.prover.jumps(velocity[None, :count])[0]
    size = abs(jumps).max(axis=1, initial=0.0)
    largest = float(size.max(initial=0.0))
    if not (np.isfinite(largest) and largest > 0.0):
        return np.zeros(0, dtype=np.int64)
    block = blocks_of(full.assembly, labels)
    open_faces = np.flatnonzero(~labels & (size > _CRACK * largest))
    return np.flatnonzero(np.isin(block, block[full.assembly.interfaces.a[open_faces]]))


def prove_condensed(full: LimitAnalysis, labels: Bits, separate: Ints | None = None) -> Proof | None:
    """Prove λ with rigid blocks but elements `separate` (k,), taking apart blocks that fail a check.

    The proof holds in the full model; it may lack the lower bound. None where the full model must be solved instead.
    """
    # Source: docs/method.md (7.1), (7.2).
    assembly, options = full.assembly, full.options
    separate = np.zeros(0, dtype=np.int64) if separate is None else separate
    solve_log: list[str] = []
    solves = 0
    for _ in range(_ROUNDS):
        rigid = rigid_blocks(assembly, labels, separate)
        if not rigid.assembly.live.any() or not len(rigid.face):
            return None
        joints = rigid.assembly.labels
        condensed = LimitAnalysis(
            rigid.assembly,
            solver=options.solver,
            gap=options.gap,
            inner_bending=options.inner_bending,
            reference=joints,
        )
        # Where the full model is large, its own repairs take less time than a simplex on rigid blocks.
        large = is_large(full.template.structure)
        proof = condensed.prove(
            joints, tuple(fallback for fallback in FALLBACKS if not large or fallback.name != "dual simplex")
        )
        scaling = condensed.template.scaling
        solves += proof.solves
        solve_log += [f"rigid: {step}" for step in proof.solve_log]
        if proof.status is Status.UNSTABLE:
            # If the assembly of rigid blocks is unstable, the full model is too: cracks only add mechanisms.
            fall = proof.collapse_below_zero or proof.motion
            lifted_fall = None if fall is None else _of_elements(full, rigid, condensed, fall)
            return Proof(status=Status.UNSTABLE, solve_log=solve_log, solves=solves, collapse_below_zero=lifted_fall)
        if proof.status is not Status.COLLAPSE or proof.state is None or proof.motion is None:
            return None
        joint_forces = proof.state.forces * scaling.face
        load = proof.state.load * scaling.load
        inner_forces = _inner_forces(full.template, labels, rigid, joint_forces, load)
        solves += 1
        if inner_forces is None:
            return None
        forces, failing = inner_forces
        if failing.size == 0:
            empty = not (joint_forces.any() or load)
            checked, blended = _checked_state(full, labels, rigid, forces, load, empty=empty)
            solves += blended
            extra = {"rigid_blocks": len(rigid.assembly.elements.free)}
            full_proof = Proof(solve_log=solve_log, solves=solves, extra=extra)
            full_proof.offer_state(checked)
            full_proof.offer_motion(_of_elements(full, rigid, condensed, proof.motion))
            full_proof.status = full.status_of(full_proof)
            return full_proof if full_proof.status in (Status.COLLAPSE, Status.UNCERTIFIED) else None
        if is_large(full.template.structure) and failing.size > _FAILING * len(rigid.assembly.elements):
            return None
        solve_log.append(f"{failing.size} blocks taken apart")
        separate = np.union1d(separate, np.flatnonzero(np.isin(rigid.group, failing)))
    return None


def _checked_state(
    full: LimitAnalysis, labels: Bits, rigid: RigidBlocks, forces: Floats, load: float, *, empty: bool
) -> tuple[State, bool]:
    """Check scaled forces (m, q) at λ in the full model, blended with a state inside where needed; True if blended.

    empty: joints between blocks carry no force.
    """
    state = full.prover.state(np.append(forces.ravel(), load / full.template.scaling.load), labels)
    if not state.admissible and empty:
        # Loads that cancel within each block leave its joints empty.
        inner_faces = ~np.isin(np.arange(len(labels)), rigid.face)
        state = full.prover.state_within(forces, labels, inner_faces)
    interior_state = None if state.admissible else full.repair.state(labels)
    if interior_state is not None:
        # equilibrium of the cells has moved forces on the boundary of a yield set a last digit too far
        state = full.prover.blend(state, interior_state, labels)
    if not state.admissible:
        state = full.unloaded(labels) or state
    return state, interior_state is not None


def _inner_forces(
    template: Template, labels: Bits, rigid: RigidBlocks, joint_forces: Floats, load: float
) -> tuple[Floats, Ints] | None:
    """Compute scaled forces (m, q) on all faces, and blocks without admissible ones; None if not finite.

    joint_forces: (m', q) resultants between blocks, load: λ, both in scene units. Blocks as in `rigid.group`.
    """
    # Given boundary forces and λ, each block maximises its own least slack, at most 1. Row `equalities`, which bounds
    # λ, is left out.
    scale, q, sets = template.scaling, template.assembly.freedoms, template.yield_set
    forces = np.zeros((len(labels), q))
    forces[rigid.face] = joint_forces / scale.face[rigid.face]
    faces, pattern = template.assembly.interfaces, sets.pattern
    support = rigid.assembly.elements.support[rigid.group]
    is_inner = np.ones(len(labels), dtype=bool)
    is_inner[rigid.face] = False
    is_inner &= ~(support[faces.a] & support[faces.b])  # Faces between supports need no forces.
    inner = np.flatnonzero(is_inner)
    if inner.size == 0:
        return forces, inner
    program = template.program(labels)
    structure = program.structure
    rows, columns = _independent_rows(template, rigid, support), _columns_of(template, is_inner)
    matrix = program.matrix.tocsr()
    target = -(template.dead + load / scale.load * template.live) - template.matrix @ forces.ravel()
    yields = structure.equalities + 1 + np.flatnonzero(is_inner[pattern.row_face])
    linear = yields[yields < structure.equalities + structure.linear]
    conic = yields[yields >= structure.equalities + structure.linear]
    of_cones = pattern.row_face[pattern.linear + beginnings(structure.cones)]
    sizes = tuple(np.array(structure.cones, dtype=np.int64)[is_inner[of_cones]].tolist())
    # one slack for each block, in its linear rows and in the first rows of its cones
    block = rigid.group[faces.a]
    blocks, block_position = np.unique(block[inner], return_inverse=True)
    of_block = np.full(int(rigid.group.max()) + 1, -1)
    of_block[blocks] = np.arange(len(blocks))
    rows_of_slack = np.concatenate([linear, conic[np.concatenate([[0], np.cumsum(sizes)])[: len(sizes)].astype(int)]])
    column_of_slack = of_block[block[pattern.row_face[rows_of_slack - structure.equalities - 1]]]
    entries = np.ones(len(rows_of_slack)), (rows_of_slack, column_of_slack)
    slack = sp.csr_array(entries, shape=(structure.shape[0], len(blocks)))
    with_slack = sp.hstack([matrix[:, columns], slack]).tocsr()
    cap = sp.hstack([sp.csr_array((len(blocks), len(columns))), sp.eye_array(len(blocks))])
    stacked = sp.vstack([with_slack[rows], with_slack[linear], cap, with_slack[conic]])
    rhs = np.concatenate([target[rows], program.rhs[linear], np.ones(len(blocks)), program.rhs[conic]])
    objective = np.concatenate([np.zeros(len(columns)), -np.ones(len(blocks))])
    # Far below yield slacks hardly depend on forces: without refinement of its steps the method stops short of balance.
    solver = ClarabelSolver(iterative_refinement_enable=True)
    raw = solver.solve(pack(stacked, rhs, objective, len(rows), len(linear) + len(blocks), sizes))
    forces_inside = raw.point[: q * inner.size].reshape(-1, q)
    if not np.all(np.isfinite(forces_inside)):
        return None
    forces[inner] = np.where(sets.active(labels)[inner], forces_inside, 0.0)
    slacks = sets.slack(forces, labels)[inner]
    return forces, blocks[np.unique(block_position[slacks < _LEAST_SLACK])]


_LEAST_SLACK = 1e-9  # slack, scaled, below which the forces of a face count as inadmissible


def _independent_rows(template: Template, rigid: RigidBlocks, support: Bools) -> Ints:
    """Return the equations (k,) of the elements that are not supported (n,), without one element of each block."""
    # Within a block that is in balance, the equations of one element follow from those of the others. Interior points
    # take the rounding of that balance for a contradiction.
    free = template.assembly.elements.free
    is_dependent = np.zeros(len(support), dtype=bool)
    is_dependent[free[np.unique(rigid.group[free], return_index=True)[1]]] = True
    return np.flatnonzero(~np.repeat((support | is_dependent)[free], template.assembly.freedoms))


def _columns_of(template: Template, selected: Bools) -> Ints:
    """Return the columns (k,) of the resultants of some faces (m,), then of their further unknowns."""
    q, count, pattern = template.assembly.freedoms, len(selected), template.yield_set.pattern
    columns = (q * np.flatnonzero(selected)[:, None] + np.arange(q)).ravel()
    if not pattern.extra:
        return columns
    # a face may have none or several further unknowns
    further = pattern.column >= q * count
    owner = np.zeros(pattern.extra, dtype=np.int64)
    owner[pattern.column[further] - q * count] = pattern.face[further]
    return np.concatenate([columns, q * count + np.flatnonzero(selected[owner])])


def _of_elements(full: LimitAnalysis, rigid: RigidBlocks, blocks_analysis: LimitAnalysis, motion: Motion) -> Motion:
    """Convert a motion of rigid blocks into a motion of the elements of the full model."""
    # Faces inside a block do not jump.
    assembly, scale = full.assembly, full.template.scaling
    mechanism = element_velocities(blocks_analysis.template, motion.velocity)[rigid.group]
    arm = assembly.elements.centroid - rigid.assembly.elements.centroid[rigid.group]
    d = assembly.dimension
    mechanism[:, :d] += spun(mechanism[:, d:], arm)
    velocity = (mechanism[assembly.elements.free] * scale.row.reshape(-1, assembly.freedoms)).ravel() / scale.load
    jumps = np.zeros(scale.face.shape)
    jumps[rigid.face] = (full.prover.transposed @ velocity).reshape(scale.face.shape)[rigid.face]
    unit = blocks_analysis.template.scaling.load / scale.load
    return Motion(velocity, jumps, 1.0, motion.margin, motion.bound * unit, motion.noise * unit)


def prove_loaded_part(full: LimitAnalysis, labels: Bits, proof_so_far: Proof) -> Proof | None:
    """Prove bounds by the elements connected to a loaded one, in their own scale; None if all are, or none holds."""
    assembly, scale = full.assembly, full.template.scaling
    elements, faces = assembly.elements, assembly.interfaces
    if proof_so_far.state is None or assembly.members:
        return None
    between_free = ~(elements.support[faces.a] | elements.support[faces.b])
    component = components(len(elements), faces.a[between_free], faces.b[between_free])
    unloaded = ~elements.support & ~np.isin(component, component[assembly.live.any(axis=1)])
    if not unloaded.any():
        return None
    part_assembly, kept_faces = without(assembly, unloaded)
    part_labels, bending = labels[kept_faces], full.options.inner_bending
    analysis = LimitAnalysis(part_assembly, gap=full.gap, inner_bending=bending, reference=part_labels)
    proof = analysis.prove(part_labels)
    if proof.status is not Status.COLLAPSE or proof.state is None or proof.motion is None:
        return None
    part_scaling = analysis.template.scaling
    per_force, per_load = part_scaling.force / scale.force, part_scaling.load / scale.load
    forces = proof_so_far.state.forces.copy()
    forces[kept_faces] = proof.state.forces * part_scaling.face / scale.face[kept_faces]
    state = State(forces, proof.state.load * per_load, proof.state.slack * per_force, proof.state.error * per_force)
    mechanism = np.zeros((len(elements), assembly.freedoms))
    mechanism[~unloaded] = element_velocities(analysis.template, proof.motion.velocity)
    velocity = (mechanism[elements.free] * scale.row).ravel() / scale.load
    jumps = (full.prover.transposed @ velocity).reshape(forces.shape)
    bound, noise = proof.motion.bound * per_load, proof.motion.noise * per_load
    motion = Motion(velocity, jumps, 1.0, proof.motion.margin, bound, noise)
    result = Proof(state=state, motion=motion, solve_log=[f"loaded part: {step}" for step in proof.solve_log])
    result.solves, result.status = proof.solves, full.status_of(Proof(state=state, motion=motion))
    return result


_ROUTE: Final = Route("contact at points", STANDARD - ADHESION - {"dry crushing"})


def point_contact_assembly(assembly: Assembly, labels: Bits) -> tuple[Assembly, Ints]:
    """Build the assembly of concave contact: a point face per hull corner of a dry face; and its face (m',)."""
    # Labels are dry for point faces and inner for all others. A point face has no area, no moments and a polygon of one
    # point. Its sizes are those of its parent face; they only scale moments, which a point face does not have. Corners
    # inside the hull are omitted: their cones are sums of the cones of the hull corners. Source: Livesley 1992;
    # docs/method.md (2.13). A point has no area: dry compressive and shear strengths are refused.
    faces = assembly.interfaces
    if assembly.members.bond is not None:
        raise ParameterError("contact", "points have no tensile strength of bond", "convex contact there")
    assembly.strengths(_ROUTE, labels)  # refuses what it does not know
    points: list[Floats] = [faces.polygon[face].mean(axis=0)[None] for face in range(len(faces))]
    dry = np.flatnonzero(labels)
    for face, outline in zip(dry.tolist(), local_hulls(faces, dry), strict=True):
        points[face] = faces.origin[face] + outline @ np.array([faces.e1[face], faces.e2[face]])
    parent = np.repeat(np.arange(len(faces)), [len(p) for p in points])
    positions = np.concatenate(points) if points else np.zeros((0, 3))
    is_point = labels[parent]
    point_faces = faces.take(parent)
    point_faces = replace(
        point_faces,
        origin=np.where(is_point[:, None], positions, point_faces.origin),
        area=np.where(is_point, 0.0, point_faces.area),
        rectangle=point_faces.rectangle & ~is_point,
        polygon=tuple(positions[[k]] if is_point[k] else outline for k, outline in enumerate(point_faces.polygon)),
    )
    expanded = replace(
        assembly,
        interfaces=point_faces,
        face_strengths=replace(assembly.face_strengths, criteria=()).take(parent),  # any in use is refused above
        labels=np.where(is_point, DRY, INNER).astype(bool),
        members=assembly.members.joined(np.arange(len(assembly.elements)), parent),
    )
    return expanded, parent


def proof_of_faces(full: LimitAnalysis, points: LimitAnalysis, parent: Ints, proof: Proof) -> Proof:
    """Convert a proof about point contacts to one about whole faces, without the ray and the collapse below zero."""
    whole, pointwise = full.template.scaling, points.template.scaling
    unit = pointwise.load / whole.load

    def state(of_points: State | None) -> State | None:
        if of_points is None:
            return None
        forces = resultants_of_faces(full.assembly, points.assembly, parent, of_points.forces * pointwise.face)
        return replace(of_points, forces=forces / whole.face, load=of_points.load * unit)

    motion = proof.motion
    if motion is not None:
        velocities = element_velocities(points.template, motion.velocity)[full.assembly.elements.free]
        velocity = velocities.ravel() * whole.row.ravel() / whole.load
        jumps = (full.prover.transposed @ velocity).reshape(whole.face.shape)
        motion = replace(motion, velocity=velocity, jumps=jumps, bound=motion.bound * unit, noise=motion.noise * unit)
    return replace(
        proof,
        state=state(proof.state),
        found=state(proof.found),
        ray=None,
        collapse_below_zero=None,
        motion=motion,
        guess=proof.guess * unit,
        associative=proof.associative * unit,
    )


def resultants_of_faces(assembly: Assembly, points: Assembly, parent: Ints, forces: Floats) -> Floats:
    """Compute the resultants (m, 6) of whole faces about their centroids from point forces."""
    faces = assembly.interfaces
    arm = points.interfaces.origin - faces.origin[parent]
    x1 = np.einsum("ij,ij->i", arm, faces.e1[parent])
    x2 = np.einsum("ij,ij->i", arm, faces.e2[parent])
    n, v1, v2 = forces[:, 0], forces[:, 1], forces[:, 2]
    # Moment of n·N + e1·V1 + e2·V2 acting at x1 e1 + x2 e2, in the frame (e1, e2, n) with e1 × e2 = n.
    about_centroid = forces.copy()
    about_centroid[:, 3] += x2 * n
    about_centroid[:, 4] -= x1 * n
    about_centroid[:, 5] += x1 * v2 - x2 * v1
    total = np.zeros((len(faces), 6))
    np.add.at(total, parent, about_centroid)
    return total


_PRESCRIBED: Final = Route("prescribed friction")


def limit_analysis(
    assembly: Assembly, options: Model, reference: Bits | None = None, *, single_labelling: bool = False
) -> LimitAnalysis:
    """Build the limit analysis that `solve_labelling` needs for the given options.

    Parameters
    ----------
    assembly : Assembly
        Assembly without load cases, or one load case of an assembly.
    options : Model
        Only solver, gap and inner bending are used here.
    reference : (m,) bool array, optional
        Labelling on which solvers are set up, True = dry. Default: all faces dry.
    single_labelling : bool, optional
        Only one labelling will be solved; the analysis is set up for it where that is faster.

    Returns
    -------
    LimitAnalysis
        Analysis under associative friction.
    """
    solver, gap, bending = options.solver, options.gap, options.inner_bending
    return LimitAnalysis(
        assembly,
        solver=solver,
        gap=gap,
        inner_bending=bending,
        reference=reference,
        single_labelling=single_labelling,
        seconds=options.seconds,
    )


def require_model(assembly: Assembly, options: Model, dry: Bits) -> None:
    """Raise InputError if options do not support an assembly; `dry` (m,): faces that may be dry."""
    if options.effective_area:
        require_rectangles(assembly, dry)
    if options.friction != "associative":
        assembly.strengths(_PRESCRIBED)  # refuses a criterion, whose rows have no c and μ of their own
    if options.solver != "auto":  # spares the analysis
        for case in assembly.by_case:
            require_solver_accepts(limit_analysis(case, options), options)


def require_solver_accepts(analysis: LimitAnalysis, options: Model) -> None:
    """Raise InputError, naming `solver`, if a solver does not accept the programs of an analysis."""
    if options.solver == "auto":
        return
    try:
        analysis.first_solver.require(analysis.template.structure)
    except SolverError as error:
        raise ParameterError("solver", str(error), "a solver that takes this scene") from None


def solve_labelling(
    analysis: LimitAnalysis, labels: Bits, options: Model, *, stands: bool = False, pruning_threshold: float = -math.inf
) -> Proof:
    """Prove the load factor of one labelling under the given options.

    Parameters
    ----------
    analysis : LimitAnalysis
        Analysis returned by `limit_analysis` for the same options.
    labels : (m,) bool array
        True = dry.
    options : Model
        Modelling options.
    stands : bool, optional
        Also decide whether the structure stands at λ = 0.
    pruning_threshold : float, optional
        λ in scene units at or below which the labelling is irrelevant, used by zero dilation alone.

    Returns
    -------
    Proof
        Scaled as `analysis`. Under concave contact it is transferred from points to whole faces.
    """
    if options.contact == "concave" and analysis.assembly.dimension == 3:
        points, parent = point_contact_assembly(analysis.assembly, labels)
        point_analysis = limit_analysis(points, options, reference=points.labels)
        proof = _proof(point_analysis, points.labels, options, stands, pruning_threshold)
        return proof_of_faces(analysis, point_analysis, parent, proof)
    return _proof(analysis, labels, options, stands, pruning_threshold)


def _proof(analysis: LimitAnalysis, labels: Bits, options: Model, stands: bool, pruning_threshold: float) -> Proof:
    """Prove λ of one labelling under the friction of the options, on the contacts as given."""
    if options.friction == "zero-dilation":
        proof: Proof = part("dilation")(analysis, labels, options, stands, pruning_threshold)
        return proof
    if options.effective_area:
        return prove_effective_area(analysis, labels, stands=stands)
    return analysis.prove(labels, FALLBACKS_BY_CONDENSE[options.condense], stands=stands)


# --- fallbacks with rigid blocks ----------------------------------------------------------------------------


def _rigid_blocks(attempt: ProofAttempt) -> None:
    """Prove bounds with rigid blocks, and adopt them in the attempt if this succeeds."""
    proof = prove_condensed(cast(LimitAnalysis, attempt.analysis), attempt.labels)
    if proof is not None:
        attempt.adopt(proof)


def _rigid_where_uncracked(attempt: ProofAttempt) -> None:
    """Adopt bounds with rigid blocks, except for blocks that crack in the last answer, see `cracked`."""
    analysis, raw = cast(LimitAnalysis, attempt.analysis), attempt.raw
    cracked_elements = None
    if raw is not None and raw.status is not RawStatus.UNBOUNDED:
        cracked_elements = cracked(analysis, attempt.labels, raw.dual)
    proof = prove_condensed(analysis, attempt.labels, cracked_elements)
    if proof is not None:
        attempt.adopt(proof)


def _loaded_part(attempt: ProofAttempt) -> None:
    """Prove bounds in the scale of the loaded part, and adopt them in the attempt if this succeeds."""
    proof = prove_loaded_part(cast(LimitAnalysis, attempt.analysis), attempt.labels, attempt.proof)
    if proof is not None:
        attempt.adopt(proof)


def _strong(attempt: ProofAttempt) -> bool:
    """Return True if the inner faces are so strong that rigid blocks are tried first."""
    return worth_condensing(attempt.template, attempt.labels)


def _large(attempt: ProofAttempt) -> bool:
    """Return True if an attempt is open, with inner faces and a large program, see `is_large`."""
    return attempt.open and not attempt.labels.all() and is_large(attempt.template.structure)


def _large_bounded(attempt: ProofAttempt) -> bool:
    """Return True if `_large`, and repairs are slow: the last answer is no ray and has no mechanism."""
    ray = attempt.raw is not None and attempt.raw.status is RawStatus.UNBOUNDED
    return _large(attempt) and not ray and not attempt.mechanism_found


def _large_unbounded(attempt: ProofAttempt) -> bool:
    """Return True if `_large`, and quick repairs of a ray or state have not settled the last answer."""
    return _large(attempt) and not _large_bounded(attempt)


def _large_crushing(attempt: ProofAttempt) -> bool:
    """Return True if `_large` holds and programs have the accuracy for faces that crush."""
    return _large(attempt) and attempt.template.precision is tolerances.CRUSHING


def _small(attempt: ProofAttempt) -> bool:
    """Return True if an attempt is open, with inner faces, and its program is not large."""
    return attempt.open and not attempt.labels.all() and not is_large(attempt.template.structure)


# Bounds that the fallback with rigid blocks may supply, shared by all entries of `FALLBACKS_BY_CONDENSE`
_SUPPLIES: Final = "both bounds, by blocks that are rigid until shown otherwise: no rounding is left in their cracks"

# Rigid blocks for large programs, tried before the first repair
_LARGE: Final = Fallback("rigid blocks: repairs would take longer", _large_bounded, _rigid_where_uncracked, _SUPPLIES)

# Rigid blocks for large programs that a solver calls unbounded, tried after the first repair
_UNSETTLED: Final = Fallback("rigid blocks: rays are not settled", _large_unbounded, _rigid_where_uncracked, _SUPPLIES)

# A second solve of large crushable programs, whose usual margin alone can leave the bracket too wide
_LESS_MARGIN: Final = Fallback(
    "less margin: rigid blocks would take longer",
    _large_crushing,
    ProofAttempt.solve_with_less_margin,
    "a narrower bracket of large crushable scenes",
)

FALLBACKS_BY_CONDENSE: Final[dict[str, tuple[Fallback, ...]]] = {
    "off": FALLBACKS,
    "on": (Fallback("rigid blocks", lambda attempt: True, _rigid_blocks, _SUPPLIES), *FALLBACKS),
    "auto": (
        Fallback("rigid blocks: strong inner faces", _strong, _rigid_blocks, _SUPPLIES),
        *insert_before(
            insert_before(insert_before(FALLBACKS, "repair", _LARGE), _LARGE.name, _LESS_MARGIN),
            "ray by batch solver",
            _UNSETTLED,
        ),
        Fallback(
            "loaded part",
            lambda attempt: attempt.wide_relative_to_load_factor,
            _loaded_part,
            "λ of light parts beside heavy ones that they do not touch",
        ),
        Fallback("rigid blocks: strengths far above some loads", _small, _rigid_blocks, _SUPPLIES),
    ),
}
"""Fallbacks tried in order, by the value of `Model.condense` ("off", "on", "auto")."""
