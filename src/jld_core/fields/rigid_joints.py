"""Meshes of dry joints, fitted by rigid blocks before any field is solved for.

Linear tractions cannot press at a corner, where hinges turn; small programs tell what that costs in each triangle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.fields.cones import ConeSizes, Rows, solve_cones
from jld_core.fields.forms import across
from jld_core.fields.mesh import Mesh, halve_edges
from jld_core.fields.problem import Problem
from jld_core.linalg import components

_SHARE = 0.4  # share of the gap asked for that linear tractions may cost; the fields in the blocks have the rest

_MOST = 1.1  # ratio of the numbers of tetrahedra of the fitted and the given mesh at which fitting ends

# Largest pressure of a joint, relative to the uniaxial strength of the blocks. Fields cannot spread more: with 1 the
# lower bound of a corner is 0.431, with 0.25 it is 0.436.
_PRESSED = 0.25

_MARKED = 0.5  # share of the loss that the triangles halved at a time hold together (Dörfler marking)

# Relative difference below which losses or lengths count as equal, so that symmetric meshes stay symmetric
_EQUAL = 1e-3

_ASPECT = 0.05  # weight of the length alone in the choice of an edge, as in `bisect`

_EDGES = np.array([[0, 1], [0, 2], [1, 2]])  # local corners of the three edges of a triangle


def fitted_joints(mesh: Mesh, problem_on: Callable[[Mesh], Problem], labels: Bits, gap: float) -> Mesh:
    """Halve edges of dry joints where tractions lose most of λ; decides how near bounds are, not whether they hold."""
    # The cost is estimated by rigid blocks: λ under linear tractions against λ under forces at the nodes,
    # docs/method.md (10.8).
    most_tetrahedra = _MOST * len(mesh)
    problem = problem_on(mesh)
    blocks = RigidBlocks.of(problem, labels)
    if not problem.is_dry(labels).any() or not blocks.free.any():
        return mesh
    by_forces = rigid_balance(problem, blocks, at_nodes=True)
    if by_forces is None or not by_forces.factor > 0.0:
        return mesh
    while True:
        by_tractions = rigid_balance(problem, blocks, at_nodes=False)
        if by_tractions is None or by_tractions.factor >= (1.0 - _SHARE * gap) * by_forces.factor:
            return mesh
        finer = halve_edges(mesh, _edges_of_loss(problem, blocks, by_tractions.traction, by_forces.velocity))
        if len(finer) > most_tetrahedra or len(finer) == len(mesh):
            return mesh
        mesh, problem = finer, problem_on(finer)


@dataclass(frozen=True)
class RigidBlocks:
    """Rigid blocks of a labelling: cells that inner interfaces join."""

    of_cell: Ints  # (cells,) number of the block of each cell
    free: Bools  # (b,) False for blocks that an inner interface ties to a support
    labels: Bits  # (m,) True = dry

    def dry(self, problem: Problem) -> Ints:
        """Return the triangles (k,) on dry interfaces, those at supports included."""
        return np.flatnonzero(problem.is_dry(self.labels))

    @classmethod
    def of(cls, problem: Problem, labels: Bits) -> RigidBlocks:
        """Find the blocks of a labelling (m,), True = dry, of a spatial problem."""
        sides, cell = problem.sides, problem.mesh.cell
        count = int(cell.max()) + 1
        inner = (problem.face >= 0) & ~problem.is_dry(labels)
        between_cells = inner & (sides.b >= 0)
        block = components(count, cell[sides.a[between_cells]], cell[sides.b[between_cells]])
        free = np.zeros(int(block.max()) + 1, dtype=bool)
        free[block[cell]] = True
        free[block[cell[sides.a[inner & (sides.b < 0)]]]] = False
        return cls(block, free, labels)


@dataclass(frozen=True)
class RigidBalance:
    """Equilibrium of rigid blocks under the largest λ, scaled; not certified."""

    factor: float  # λ
    traction: Floats  # (k, 3, 3) stress vectors at the three corners of the k triangles on dry joints
    velocity: Floats  # (b, 6) rigid motion of each block from the multipliers: velocity at the origin, then rotation


def rigid_balance(problem: Problem, blocks: RigidBlocks, *, at_nodes: bool) -> RigidBalance | None:
    """Maximise λ in equilibrium of rigid blocks (10.8), scaled, uncertified; None if unsolved.

    at_nodes: forces at the corners of triangles, else linear tractions.
    """
    rows = blocks.dry(problem)
    balance = _equilibrium_matrix(problem, blocks, rows, at_nodes=at_nodes)
    live = _resultants(problem, blocks, problem.live, problem.pull)
    dead = _resultants(problem, blocks, problem.dead, problem.dead_pull)
    free = np.repeat(blocks.free, 6)
    equations = sp.hstack([balance, sp.csr_array(live.reshape(-1, 1))], format="csr")[free]
    linear, threes = _joint_cones(problem, rows)
    parts = [part for part in (linear, threes) if part.count]
    width = 9 * len(rows) + 1
    matrix = sp.csr_array(sp.vstack([equations, *(part.matrix(width) for part in parts)]))
    right = np.concatenate([-dead.ravel()[free], *(part.right for part in parts)])
    objective = np.zeros(width)
    objective[-1] = -1.0
    sizes = ConeSizes(int(free.sum()), linear.count, threes.count // 3)
    answer = solve_cones(objective, matrix, right, sizes)
    if answer.status not in ("Solved", "AlmostSolved"):
        return None
    velocity = np.zeros(len(free))
    velocity[free] = answer.dual[: sizes.zero]
    return RigidBalance(-answer.objective, answer.point[:-1].reshape(-1, 3, 3), velocity.reshape(-1, 6))


def _equilibrium_matrix(problem: Problem, blocks: RigidBlocks, rows: Ints, *, at_nodes: bool) -> sp.csr_array:
    """Return the map (6b, 9k) from tractions on dry triangles `rows` (k,) to wrenches of blocks about the origin."""
    sides, count = problem.sides, len(rows)
    corners = problem.mesh.corners[sides.a[rows][:, None], sides.corner_a[rows]]
    # the resultant of a linear pressure with value 1 at one corner acts at (2, 1, 1)/4
    points = corners if at_nodes else (corners + corners.sum(axis=1, keepdims=True)) / 4.0
    wrench = _wrenches(points) * (sides.area[rows] / 3.0)[:, None, None, None]  # (k, 3, 6, 3)
    # column 9 k + 3 corner + axis
    columns = np.broadcast_to(
        9 * np.arange(count)[:, None, None, None] + 3 * np.arange(3)[:, None, None] + np.arange(3), wrench.shape
    )
    entries = []
    for sign, has_side, tetrahedra in ((1.0, np.ones(count, dtype=bool), sides.a), (-1.0, sides.b[rows] >= 0, sides.b)):
        first = 6 * blocks.of_cell[problem.mesh.cell[tetrahedra[rows[has_side]]]]
        row = np.broadcast_to(first[:, None, None, None] + np.arange(6)[:, None], wrench[has_side].shape)
        entries.append((sign * wrench[has_side].ravel(), row.ravel(), columns[has_side].ravel()))
    value, row, column = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    return sp.csr_array((value, (row, column)), shape=(6 * len(blocks.free), 9 * count))


def _wrenches(points: Floats) -> Floats:
    """Return maps (..., 6, 3) from forces at places (..., 3) to wrenches about the origin."""
    maps = np.zeros((*points.shape[:-1], 6, 3))
    maps[..., :3, :] = np.eye(3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        maps[..., 3 + i, k], maps[..., 3 + i, j] = points[..., j], -points[..., k]
    return maps


def _resultants(problem: Problem, blocks: RigidBlocks, body: Floats, traction: Floats) -> Floats:
    """Sum body forces (t, 3) and tractions (f, 3, 3) to wrenches (b, 6) of blocks about the origin, scaled."""
    mesh, sides = problem.mesh, problem.sides
    total = np.zeros((len(blocks.free), 6))
    force = body * mesh.volume[:, None]
    np.add.at(total, blocks.of_cell[mesh.cell], np.einsum("tij,tj->ti", _wrenches(mesh.corners.mean(axis=1)), force))
    rows = np.flatnonzero(traction.any(axis=(1, 2)))
    corner = mesh.corners[sides.a[rows][:, None], sides.corner_a[rows]]
    share = (sides.area[rows] / 12.0)[:, None, None]
    force = (traction[rows] + traction[rows].sum(axis=1, keepdims=True)) * share
    block = blocks.of_cell[mesh.cell[sides.a[rows]]]
    np.add.at(total, block, np.einsum("kcij,kcj->ki", _wrenches(corner), force))
    return total


def _joint_cones(problem: Problem, rows: Ints) -> tuple[Rows, Rows]:
    """Return the yield conditions (10.5) of k dry triangles over tractions (9k,): inequalities, cones of size 3."""
    # Pressure is limited by crushing of the joint, and by a share of the strength of the blocks in one direction.
    face, normal = problem.face[rows], problem.sides.normal[rows]
    tangents = across(normal)
    mu, c = problem.joints.friction[face], problem.joints.shear[face]
    # tractions near the strength of the blocks would concentrate where no field can spread them
    strength = min(2.0 * problem.material.intercept / (1.0 - problem.material.sine), problem.material.crushing)
    crush = np.minimum(problem.joints.crushing[face], _PRESSED * strength)
    crushable = np.flatnonzero(np.isfinite(crush))
    linear, threes = Rows(), Rows()
    for corner in range(3):
        columns = 9 * np.arange(len(rows))[:, None] + 3 * corner + np.arange(3)
        linear.add([(columns, normal)], 0.0, len(rows))
        linear.add([(columns[crushable], -normal[crushable])], crush[crushable], len(crushable))
        cone = np.stack([mu[:, None] * normal, *tangents], axis=1)  # head μ σ, then the shear tractions
        right = np.zeros((len(rows), 3))
        right[:, 0] = c
        threes.add([(np.repeat(columns, 3, axis=0), cone.reshape(-1, 3))], right.ravel(), 3 * len(rows))
    return linear, threes


def _edges_of_loss(problem: Problem, blocks: RigidBlocks, traction: Floats, velocity: Floats) -> Ints:
    """Return the joint edges (e, 2) of the triangles with half of the lost power, longest first."""
    # The loss is the power of corner tractions against jumps. Each triangle gives the edge along which it changes most,
    # with a small bonus for length.
    sides, rows, mesh = problem.sides, blocks.dry(problem), problem.mesh
    nodes = mesh.simplices[sides.a[rows][:, None], sides.corner_a[rows]]
    corners = mesh.points[nodes]
    # the transpose of the map of forces to wrenches gives velocities of points by those of blocks
    wrench_maps = _wrenches(corners)
    jump = -np.einsum("kcij,ki->kcj", wrench_maps, velocity[blocks.of_cell[mesh.cell[sides.a[rows]]]])
    two_sided = sides.b[rows] >= 0
    jump[two_sided] += np.einsum(
        "kcij,ki->kcj", wrench_maps[two_sided], velocity[blocks.of_cell[mesh.cell[sides.b[rows[two_sided]]]]]
    )
    force = (traction + traction.sum(axis=1, keepdims=True)) * (sides.area[rows] / 12.0)[:, None, None]
    lost_power = np.maximum(-np.einsum("kci,kci->kc", force, jump), 0.0)
    total = lost_power.sum(axis=1)
    if not total.any():
        return np.zeros((0, 2), dtype=np.int64)
    ranked = np.sort(total)[::-1]
    last_marked = ranked[int(np.searchsorted(np.cumsum(ranked), _MARKED * ranked.sum()))]
    marked = np.flatnonzero(total >= (1.0 - _EQUAL) * last_marked)
    share = lost_power[marked] / total[marked][:, None]
    ends = corners[marked][:, _EDGES]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    steep = length * (_ASPECT + abs(share[:, _EDGES[:, 0]] - share[:, _EDGES[:, 1]]))
    edge = np.argmax(steep >= (1.0 - _EQUAL) * steep.max(axis=1, keepdims=True), axis=1)
    edges = np.unique(np.sort(nodes[marked[:, None], _EDGES[edge]], axis=1), axis=0)
    size = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    return np.asarray(edges[np.argsort(-np.round(size / size.max(), 6), kind="stable")])
