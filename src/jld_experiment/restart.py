"""Write a push to a file and read it back, so that it can be continued later."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from jld_core.errors import InputError
from jld_experiment.driving import Push
from jld_experiment.specimen import Specimen, State

_STATES = ("at_collapse", "at_end")


def write_push(path: Path, found: Push) -> None:
    """Write a push with its states to a file of NumPy arrays (.npz), with all digits."""
    arrays = dict[str, Any]()
    for field in fields(found):
        value = getattr(found, field.name)
        if field.name in _STATES:
            arrays |= {f"{field.name}.{name}": array for name, array in _arrays(value).items()}
        else:
            arrays[field.name] = value
    with path.open("wb") as file:
        np.savez(file, **arrays)


def read_push(path: Path, specimen: Specimen) -> Push:
    """Read a push of a specimen from a file of `write_push`.

    Raises InputError if the file is of another structure or other settings.
    """
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    states = dict[str, Any]()
    for name in _STATES:
        fresh = specimen.fresh()
        for key, array in _arrays(fresh).items():
            found = arrays.get(f"{name}.{key}")
            if found is None or found.shape != array.shape:
                problem = f"{name}.{key} does not fit the structure and settings"
                raise InputError(str(path), problem, "a file of the same scene, labels and settings")
            array[...] = found
        states[name] = fresh
    rest = {field.name: arrays[field.name] for field in fields(Push) if field.name not in _STATES}
    for name in ("periods", "rising", "stopped"):
        rest[name] = rest[name].item()
    return Push(**states, **rest)


def _arrays(state: State) -> dict[str, Any]:
    """Return all arrays of a state by name; those of its geometry begin with "geometry."."""
    found = {field.name: getattr(state, field.name) for field in fields(state) if field.name != "geometry"}
    if state.geometry is not None:
        found |= {f"geometry.{name}": array for name, array in state.geometry._asdict().items()}
    return found
