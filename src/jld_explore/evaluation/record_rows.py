"""Write and compare rows of a record: checksums and the header check."""

from __future__ import annotations

import json
import math
import zlib
from typing import Any, Final

import numpy as np

from jld_core.errors import InputError

BOUND: Final = "bound"
"""Key of the proven bound in the table `meta`."""

WITHDRAWN: Final = "withdrawn"
"""Key of the reasons for withdrawn bounds in the table `meta`."""

CONFLICTS_OF: Final = "conflicts of"
"""Key in the table `meta` of the problem for which the recorded conflicts were proven."""

# Keys of `meta` that may differ between a record and the study that resumes it
_CHANGING: Final = {CONFLICTS_OF, BOUND, WITHDRAWN}


def checksum(kind: str, value: float, *parts: bytes) -> int:
    """Return the CRC-32 of a row: its kind, its number and the bytes of its other columns."""
    # SQLite does not store the sign of zero; adding 0.0 turns −0.0 into 0.0.
    return zlib.crc32(b"".join([kind.encode(), np.float64(value + 0.0).tobytes(), *parts]))


def parsed(value: object) -> Any:
    """Parse a JSON text; return None for invalid JSON."""
    try:
        return json.loads(str(value))
    except ValueError:
        return None


def require_same(path: str, old: dict[str, Any], new: dict[str, Any]) -> None:
    """Raise InputError for the first entry in which a record differs from the current study.

    The bound, withdrawn bounds and the problem of the conflicts may differ. path: name of the record in the message.
    old, new: header of the record and of the study.
    """
    for key in sorted((old.keys() | new.keys()) - _CHANGING):
        if old.get(key) != new.get(key):
            raise InputError(
                path,
                f"it was made with {key} {_shown(old.get(key))}, not {_shown(new.get(key))}",
                f"the same {key} to resume",
            )


def _shown(value: object) -> str:
    """Return a value as JSON text of at most 60 characters for messages."""
    if isinstance(value, float) and math.isnan(value):
        return "none"
    text = json.dumps(value)
    return text if len(text) <= 60 else text[:57] + "..."
