"""How rows of a record are written and compared: checksums, proofs as rows, and what a record must agree with."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from jld_core.errors import InputError
from jld_explore.evaluation.certificates import Proofs

BOUND: Final = "bound"
"""Key of the proven bound in the table `meta`."""

WITHDRAWN: Final = "withdrawn"
"""Key of the reasons for which bounds were withdrawn."""

CONFLICTS_OF: Final = "conflicts of"
"""Key of what the conflicts on record depend on."""

_CHANGING: Final = {CONFLICTS_OF, BOUND, WITHDRAWN}
"""Keys that may differ between a record and the study that goes on with it."""


def checksum(kind: str, value: float, *parts: bytes) -> int:
    """Return the checksum of a row: its kind, its number and the bytes of its other columns."""
    # SQLite keeps no sign of a zero, so that −0.0 is read as 0.0
    return zlib.crc32(b"".join([kind.encode(), np.float64(value + 0.0).tobytes(), *parts]))


def proof_rows(proofs: Proofs | None) -> Iterator[tuple[str, float, bytes, bytes, int]]:
    """Rows of a solve's proofs: kind, value, what is known under either label, checksum."""
    if proofs is None:
        return
    for forces in proofs.forces:
        parts = np.packbits(forces.dry).tobytes(), np.packbits(forces.inner).tobytes()
        yield "forces", forces.load, *parts, checksum("forces", forces.load, *parts)
    for one in proofs.mechanisms:
        kind = "falls" if one.falls else "mechanism"
        parts = one.dry.astype("<f8").tobytes(), one.inner.astype("<f8").tobytes()
        yield kind, one.constant, *parts, checksum(kind, one.constant, *parts)


def parsed(value: object) -> Any:
    """Return a JSON text as what it says; None for what is no JSON."""
    try:
        return json.loads(str(value))
    except ValueError:
        return None


def require_same(path: str, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Raise InputError naming the first entry in which a record differs from the study that wants to go on."""
    for key in sorted((old.keys() | new.keys()) - _CHANGING):
        if old.get(key) != new.get(key):
            raise InputError(
                path,
                f"it was made with {key} {_shown(old.get(key))}, not {_shown(new.get(key))}",
                f"the same {key} to resume",
            )


def _shown(value: object) -> str:
    if isinstance(value, float) and math.isnan(value):
        return "none"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
