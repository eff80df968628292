"""Forces and elongations of members in a result."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.geometry import spun


def without_idle(assembly: Assembly, forces: Floats) -> Floats:
    """Set the resultants that a member cannot carry to zero, and subtract the bond from N.

    forces: (m, q) resultants, scene units; the result has the same shape. A bar carries only axial force; a pin carries
    shear, and axial force only where it states a capacity. The program leaves the other numbers free. Bond is the
    constant force of joints with tensile strength.
    """
    members, found = assembly.members, forces
    if members.bond is not None:
        found = forces.copy()
        found[: assembly.faces, 0] -= members.bond
    for k in np.flatnonzero(members.face >= 0).tolist():
        found = forces.copy() if found is forces else found
        row = found[members.face[k]]
        if not members.axial[k]:
            row[0] = 0.0
        row[1 if members.kinds[k] != "pin" else assembly.dimension :] = 0.0
    return found


def elongations(assembly: Assembly, velocity: Floats) -> Floats:
    """Return the rates of elongation (k,) of all members in a mechanism.

    velocity: (n, q) velocities of the elements about their centroids, in any unit; the result has the same unit.
    """
    d, centroid = assembly.dimension, assembly.elements.centroid
    rates = []
    for k in range(len(assembly.members)):
        held, points, forces = assembly.members.push(k)
        moves = velocity[held, :d] + spun(velocity[held, d:], points - centroid[held])
        rates.append(float(np.einsum("ij,ij->", forces, moves)))
    return np.array(rates)


def tensions(assembly: Assembly, forces: Floats) -> Floats:
    """Return the tension (k,) of all members with prestress; compression is negative.

    forces: (m, q) resultants, scene units, as is the result.
    """
    members = assembly.members
    varying = members.face >= 0
    found = members.prestress.copy()
    found[varying] -= forces[members.face[varying], 0]
    return found


def effects(assembly: Assembly, forces: Floats) -> Floats:
    """Return a force (k,) per member for pictures: tension of bars, shear of pins.

    Bars are ties and tendons. forces: (m, q) resultants, scene units, as is the result.
    """
    members, found = assembly.members, tensions(assembly, forces)
    pins = np.array([kind == "pin" for kind in members.kinds], dtype=bool)
    found[pins] = np.linalg.norm(forces[members.face[pins], 1 : assembly.dimension], axis=1)
    return found


def members_to_json(assembly: Assembly, forces: Floats | None, mechanism: Floats | None) -> list[dict[str, Any]]:
    """Return the JSON objects of all members: name, kind, elements, forces and elongation.

    The force is positive in tension; pins also have a shear. forces: (m, q) resultants; None leaves the forces None.
    mechanism: (n, q) velocities; None leaves the elongations None.
    """
    members, ids = assembly.members, assembly.elements.ids
    force = None if forces is None else tensions(assembly, forces)
    rate = None if mechanism is None else elongations(assembly, mechanism)
    found: list[dict[str, Any]] = []
    for k, name in enumerate(members.names):
        one: dict[str, Any] = {
            "name": name,
            "kind": members.kinds[k],
            "elements": [ids[e] for e in members.elements[k]],
            "force": None if force is None else float(force[k]),
        }
        if members.kinds[k] == "pin":
            across = slice(1, assembly.dimension)
            one["shear"] = None if forces is None else float(np.linalg.norm(forces[members.face[k], across]))
        one["elongation"] = None if rate is None else float(rate[k])
        found.append(one)
    return found
