"""Store the conflicts of a proof by fields on disk, with their velocity fields.

The bound of a loaded conflict is computed again from its velocity field: nothing on disk is believed.
"""

from __future__ import annotations

import io
import zipfile
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from jld_core.arrays import Floats
from jld_core.errors import InputError
from jld_core.fields.mesh import Mesh
from jld_core.files import whole_file
from jld_explore.drivers.exact.proof_state import Conflict, Mechanism

if TYPE_CHECKING:
    from jld_explore.drivers.field_proof import FieldProof

CONFLICTS_FILE: Final = "conflicts.npz"
"""Name of the file of conflicts in the folder of a study."""

_MESH: Final = [one.name for one in fields(Mesh)]  # arrays of a mesh


def save_conflicts(folder: Path, proof: FieldProof) -> None:
    """Write the conflicts of a proof with their velocity fields and meshes to one file.

    The file `CONFLICTS_FILE` is replaced as a whole. Conflicts without a velocity field in memory are left out. Without
    any conflict nothing is written.
    """
    conflicts = [one for one in proof.state.conflicts if one.mechanism is not None]
    if not conflicts:
        return
    problems, shared = proof.refuter.relaxation.problems, proof.refuter.cases
    mechanisms = [one.mechanism for one in conflicts if one.mechanism is not None]
    own = sorted({one.case for one in mechanisms if one.case >= shared})
    number = {case: shared + place for place, case in enumerate(own)}
    content: dict[str, Any] = {
        "shared": np.array(shared),
        "case": np.array([number.get(one.case, one.case) for one in mechanisms], dtype=np.int64),
        "load": np.array([proof.refuter.load_case(problems[case]) for case in own], dtype=np.int64),
        **_joined("faces", [one.faces for one in conflicts]),
        **_joined("labels", [one.labels for one in conflicts]),
        **_joined("velocity", [one.velocity.ravel() for one in mechanisms]),
    }
    for name in _MESH:
        arrays = [getattr(problems[case].mesh, name) for case in own]
        content |= _joined(f"mesh_{name}", [array.ravel() for array in arrays])
    with whole_file(folder / CONFLICTS_FILE) as fresh, fresh.open("wb") as file:
        np.savez(file, **content)


def load_conflicts(folder: Path, proof: FieldProof) -> list[Conflict]:
    """Read the conflicts that an earlier run of a study stored, and compute their bounds again.

    The meshes of the file are added to the proof. The caller adds the conflicts.

    proof: the proof, whose relaxation takes the meshes. Result: conflicts with the bounds that weighing gives; those
    without a finite bound are left out. Empty without a file, or where it has another number of load cases. Raises
    InputError if the file cannot be read.
    """
    path = folder / CONFLICTS_FILE
    if not path.exists():
        return []
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
        found = _conflicts_in(content, proof)
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        told = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(str(path), f"it is damaged ({told})", "a file as jld explore left it, or none") from None
    return found


def _conflicts_in(content: dict[str, Any], proof: FieldProof) -> list[Conflict]:
    """Compute the bounds of the conflicts of a file again, and return those with finite bounds.

    Adds the meshes of the file to `proof`. Empty where the number of load cases differs.
    """
    if int(content["shared"]) != proof.refuter.cases:
        return []
    cases = content["case"].tolist()
    parts = {name: _parted(content, f"mesh_{name}") for name in _MESH}
    for place, load in enumerate(content["load"].tolist()):
        shapes = {"points": (-1, 2), "triangles": (-1, 3), "tagged": (-1, 2)}
        arrays: dict[str, Any] = {name: parts[name][place].reshape(shapes.get(name, (-1,))) for name in _MESH}
        proof.refuter.add_problem(load, Mesh(**arrays))
    triples = zip(
        _parted(content, "faces"), _parted(content, "labels"), _parted(content, "velocity"), cases, strict=True
    )
    found = []
    for faces, labels, velocity, case in triples:
        mechanism = Mechanism(case, velocity.reshape(-1, 3, 2))
        one = Conflict(faces.astype(np.int64), labels.astype(bool), np.inf, mechanism=mechanism)
        bound = proof.refuter.weigh(one)
        if np.isfinite(bound):
            found.append(replace(one, bound=bound))
    return found


def _joined(name: str, arrays: list[Any]) -> dict[str, Any]:
    """Return arrays (j,) of different lengths as one array `name`, with lengths `name_sizes`."""
    sizes = np.array([len(array) for array in arrays], dtype=np.int64)
    return {name: np.concatenate(arrays) if arrays else np.empty(0), f"{name}_sizes": sizes}


def _parted(content: dict[str, Any], name: str) -> list[Floats]:
    """Return the arrays that `_joined` joined under a name."""
    return np.split(content[name], np.cumsum(content[f"{name}_sizes"])[:-1]) if len(content[f"{name}_sizes"]) else []
