"""Forces and elongations of members in a result."""

from __future__ import annotations

from typing import Any

import numpy as np

from jld_core.arrays import Floats
from jld_core.assembly import Assembly
from jld_core.geometry import spun


def without_idle(assembly: Assembly, forces: Floats) -> Floats:
    """Return resultants (m, q) with zeros where the interface of a member carries nothing.

    A bar has no bending, no torsion and no shear, and a pin has axial force only where it states a capacity. The
    program leaves these numbers free, because nothing depends on them. N of faces is that without bond. forces: (m, q).
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
    """Return the rates of elongation (k,) of all members.

    velocity: (n, q) velocities of the elements about their centroids, as is the unit of the result.
    """
    d, centroid = assembly.dimension, assembly.elements.centroid
    rates = []
    for k in range(len(assembly.members)):
        held, points, forces = assembly.members.push(k)
        moves = velocity[held, :d] + spun(velocity[held, d:], points - centroid[held])
        rates.append(float(np.einsum("ij,ij->", forces, moves)))
    return np.array(rates)


def tensions(assembly: Assembly, forces: Floats) -> Floats:
    """Return the tension (k,) of all members, prestress included; negative for compression.

    forces: (m, q) resultants, scene units, as is the result.
    """
    members = assembly.members
    varying = members.face >= 0
    found = members.prestress.copy()
    found[varying] -= forces[members.face[varying], 0]
    return found


def effects(assembly: Assembly, forces: Floats) -> Floats:
    """Return the tension (k,) of ties and tendons, and the shear of pins, for pictures.

    forces: (m, q) resultants, scene units, as is the result.
    """
    members, found = assembly.members, tensions(assembly, forces)
    pins = np.array([kind == "pin" for kind in members.kinds], dtype=bool)
    found[pins] = np.linalg.norm(forces[members.face[pins], 1 : assembly.dimension], axis=1)
    return found


def members_to_json(assembly: Assembly, forces: Floats | None, mechanism: Floats | None) -> list[dict[str, Any]]:
    """Return one object for each member: name, kind, elements, force, shear of a pin, and elongation.

    Forces are positive in tension. forces: (m, q) resultants, and mechanism: (n, q) velocities; None where there are
    none.
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
