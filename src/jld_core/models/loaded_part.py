"""Prove λ of the part of a structure that the live load can move, in the scale of that part.

Where a light block is loaded beside a heavy one that it does not touch, λ is so small in the scale of the whole that
last digits of the heavy block's forces hide it.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from jld_core.arrays import Bits
from jld_core.limit import LimitAnalysis, Motion, Proof, State, Status
from jld_core.limit.result_building import element_velocities
from jld_core.sub_assembly import without


def prove_loaded_part(full: LimitAnalysis, labels: Bits, known: Proof) -> Proof | None:
    """Prove bounds by the free elements that are connected to a loaded one, in a scale of their own.

    full: analysis of the whole structure. labels: (m,) True = dry. known: proof of the whole with a state, whose forces
    hold the other elements at any λ. Result: proof about the whole; None where all elements are connected to a loaded
    one, or no bounds are found.
    """
    assembly, scale = full.assembly, full.template.scaling
    elements, faces = assembly.elements, assembly.interfaces
    if known.state is None or assembly.members:
        return None
    joined = ~(elements.support[faces.a] | elements.support[faces.b])
    links = csr_array((np.ones(int(joined.sum())), (faces.a[joined], faces.b[joined])), shape=(len(elements),) * 2)
    part = connected_components(links, directed=False)[1]
    gone = ~elements.support & ~np.isin(part, part[assembly.live.any(axis=1)])
    if not gone.any():
        return None
    left, kept = without(assembly, gone)
    inner = LimitAnalysis(left, gap=full.gap, inner_bending=full.options.inner_bending, reference=labels[kept])
    proof = inner.prove(labels[kept])
    if proof.status is not Status.COLLAPSE or proof.state is None or proof.motion is None:
        return None
    own = inner.template.scaling
    share, unit = own.force / scale.force, own.load / scale.load
    forces = known.state.forces.copy()
    forces[kept] = proof.state.forces * own.face / scale.face[kept]
    state = State(forces, proof.state.load * unit, proof.state.slack * share, proof.state.error * share)
    mechanism = np.zeros((len(elements), assembly.freedoms))
    mechanism[~gone] = element_velocities(inner.template, proof.motion.velocity)
    velocity = (mechanism[elements.free] * scale.row).ravel() / scale.load
    jumps = (full.prover.transposed @ velocity).reshape(forces.shape)
    moved = proof.motion
    motion = Motion(velocity, jumps, 1.0, moved.margin, moved.bound * unit, moved.noise * unit)
    found = Proof(state=state, motion=motion, solve_log=[f"loaded part: {step}" for step in proof.solve_log])
    found.solves, found.status = proof.solves, full.status_of(Proof(state=state, motion=motion))
    return found
