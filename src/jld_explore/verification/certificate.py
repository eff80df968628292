"""The file of a certificate: lines of JSON, first what is claimed, then the reasons in order, last a digest of it all.

A reason is one line: a mechanism (`Mechanism`), one of the three rules of a segmentation (`Rule`), or a lemma that
follows from reasons before it (`Lemma`). Reasons are numbered from one, after the clauses that the scene itself gives.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jld_core.errors import InputError
from jld_core.files import whole_file

VERSION: Final = 1
_KEY: Final = "jld certificate"
_EXPECTED: Final = "a certificate as jld explore --certificate writes it"


@dataclass(frozen=True)
class Claim:
    """What a certificate says: no labelling of the scene carries more than `bound` (with load cases: their governing
    factor), scene units; `labelling`, of 'd' and 'i', carries `load_factor`, None where nothing was found.
    """

    scene: dict[str, Any]
    bound: float
    labelling: str | None = None
    load_factor: float | None = None
    made_by: str = ""


@dataclass(frozen=True)
class Mechanism:
    """Under load case `case` no labelling with these dry and inner faces carries more than the bound.

    moves: velocities of elements, whole numbers over 2**digits.
    """

    dry: tuple[int, ...]
    inner: tuple[int, ...]
    case: int
    digits: int
    moves: dict[int, tuple[int, ...]]


@dataclass(frozen=True)
class Rule:
    """A rule that no labelling breaks: kind slit (a dry face, then the inner ones that join its sides), large (inner
    faces that join too large a block), small (elements around which all faces are dry).
    """

    kind: str
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class Lemma:
    """A clause, and the numbers of those from which it follows."""

    literals: tuple[int, ...]
    by: tuple[int, ...]


Reason = Mechanism | Rule | Lemma


def write(path: Path, claim: Claim, reasons: Iterable[Reason]) -> None:
    """Write a certificate, whole or not at all."""
    head = {_KEY: VERSION, **{name: value for name, value in vars(claim).items() if name != "scene"}}
    lines = [{**head, "scene": claim.scene}, *(_line(reason) for reason in reasons)]
    text = "".join(json.dumps(line, separators=(",", ":"), allow_nan=False) + "\n" for line in lines).encode()
    digest = json.dumps({"sha256": hashlib.sha256(text).hexdigest()}) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as fresh:
        fresh.write_bytes(text + digest.encode())


def _line(reason: Reason) -> dict[str, Any]:
    if isinstance(reason, Mechanism):
        moves = {str(element): velocity for element, velocity in reason.moves.items()}
        return {"dry": reason.dry, "inner": reason.inner, "case": reason.case, "digits": reason.digits, "moves": moves}
    if isinstance(reason, Rule):
        return {reason.kind: reason.numbers}
    return {"lemma": reason.literals, "by": reason.by}


def read(path: Path) -> tuple[Claim, list[Reason]]:
    """Read a certificate. Raises InputError where it is none, or not whole; nothing of it is believed yet."""
    try:
        text = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), error.strerror or "it cannot be read", _EXPECTED) from None
    try:
        lines = [json.loads(line) for line in text.splitlines()]
        head, last = lines[0], lines[-1]
        claim = Claim(**{name: head[name] for name in Claim.__dataclass_fields__})
        version, digest = head[_KEY], last["sha256"]
        known = isinstance(claim.scene, dict) and isinstance(claim.bound, float)
        reasons = list(_reasons(lines[1:-1]))
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise InputError(str(path), "it is no certificate, or not whole", _EXPECTED) from None
    if version != VERSION or not known:
        raise InputError(str(path), f"it is of version {version!r}", f"version {VERSION}")
    body = text[: text.rstrip(b"\n").rfind(b"\n") + 1]
    if hashlib.sha256(body).hexdigest() != digest:
        raise InputError(str(path), "its digest is not that of its lines", "a certificate as it was written")
    return claim, reasons


def _reasons(lines: list[dict[str, Any]]) -> Iterator[Reason]:
    for line in lines:
        if "moves" in line:
            moves = {int(element): _numbers(velocity) for element, velocity in line["moves"].items()}
            case, digits = _numbers([line["case"], line["digits"]])
            if not 0 <= digits < 10_000:
                raise ValueError
            yield Mechanism(_numbers(line["dry"]), _numbers(line["inner"]), case, digits, moves)
        elif "lemma" in line:
            yield Lemma(_numbers(line["lemma"]), _numbers(line["by"]))
        else:
            ((kind, numbers),) = line.items()
            yield Rule(kind, _numbers(numbers))


def _numbers(values: list[Any]) -> tuple[int, ...]:
    if any(type(value) is not int for value in values):
        raise ValueError
    return tuple(values)
