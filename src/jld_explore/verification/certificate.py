"""Read and write certificates: JSON lines with the claim, numbered reasons and a digest."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeVar

from jld_core.errors import InputError
from jld_core.files import whole_file

VERSION: Final = 1  # version of the file format
# exclusive limit on binary digits of velocities; a double has fewer than 1100 after its point
MOST_DIGITS: Final = 10_000
_KEY: Final = "jld certificate"  # key of the version in the first line
# Remedy in error messages about a damaged certificate
_EXPECTED: Final = "a certificate as jld explore --certificate writes it"


@dataclass(frozen=True)
class Claim:
    """Statement of a certificate: no labelling of the scene carries more than `bound`."""

    scene: dict[str, Any]  # scene as JSON, not validated
    bound: float  # upper bound on λ, scene units; with load cases on the governing factor
    labelling: str | None = None  # best labelling found, letters 'd' and 'i'
    load_factor: float | None = None  # λ that `labelling` carries; None if no labelling was found
    made_by: str = ""  # name of the program that wrote the certificate


@dataclass(frozen=True)
class Mechanism:
    """Reason: a mechanism by which no labelling with these labels carries more than the bound."""

    dry: tuple[int, ...]  # faces that are dry
    inner: tuple[int, ...]  # faces that are inner
    case: int  # position of the load case
    digits: int  # binary digits of the velocities after the point
    moves: dict[int, tuple[int, ...]]  # velocities of elements, as integers over 2**digits


@dataclass(frozen=True)
class BlockMechanism:
    """Reason: mechanisms of all possible blocks by which no labelling with these labels carries more than the bound."""

    # dry, inner, case, digits: as of `Mechanism`, for all numbers below
    dry: tuple[int, ...]
    inner: tuple[int, ...]
    case: int
    digits: int
    walls: dict[int, tuple[int, ...]]  # velocities of faces, from which blocks on either side open
    prices: dict[int, tuple[int, ...]]  # multipliers v and σ of elements, docs/method.md (6.6)
    blocks: dict[tuple[int, ...], tuple[int, ...]]  # velocities of the elements of a block, one after the other


@dataclass(frozen=True)
class Rule:
    """Reason: a rule of the scene that excludes labellings."""

    kind: str  # "slit", "large" or "small"
    # for "slit" a dry face, then the inner faces that join its two sides. For "large" inner faces that join a block
    # above a limit. For "small" elements enclosed by dry faces whose block is below a limit.
    numbers: tuple[int, ...]


@dataclass(frozen=True)
class Lemma:
    """Reason: a clause that follows from earlier clauses by unit propagation."""

    literals: tuple[int, ...]
    by: tuple[int, ...]  # numbers of the clauses used, in order


Reason = Mechanism | BlockMechanism | Rule | Lemma


def write_lines(path: Path, lines: Iterable[dict[str, Any]]) -> None:
    """Write JSON objects one per line, with their digest (SHA-256) in a last line, atomically."""
    text = "".join(json.dumps(line, separators=(",", ":"), allow_nan=False) + "\n" for line in lines).encode()
    digest = json.dumps({"sha256": hashlib.sha256(text).hexdigest()}) + "\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as fresh:
        fresh.write_bytes(text + digest.encode())


def write(path: Path, claim: Claim, reasons: Iterable[Reason]) -> None:
    head = {_KEY: VERSION, **{name: value for name, value in vars(claim).items() if name != "scene"}}
    lines = [{**head, "scene": claim.scene}, *(_line(reason) for reason in reasons)]
    write_lines(path, lines)


def _line(reason: Reason) -> dict[str, Any]:
    """Return a reason or lemma as a line of the certificate."""
    if isinstance(reason, Mechanism):
        moves = {str(element): velocity for element, velocity in reason.moves.items()}
        return {"dry": reason.dry, "inner": reason.inner, "case": reason.case, "digits": reason.digits, "moves": moves}
    if isinstance(reason, BlockMechanism):
        return {**vars(reason), "blocks": list(reason.blocks.items())}
    if isinstance(reason, Rule):
        return {reason.kind: reason.numbers}
    return {"lemma": reason.literals, "by": reason.by}


Content = TypeVar("Content")


def read_lines(
    path: Path, key: str, expected: str, readable: int, parse: Callable[[dict[str, Any], list[Any]], Content]
) -> Content:
    """Return what `parse` makes of the first line of a file, without its version under `key`, and of the others.

    InputError: a file that is none, or not whole, as `parse` says by ValueError; of another version; or changed.
    """
    kind = key.removeprefix("jld ")
    try:
        text = path.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(str(path), getattr(error, "strerror", None) or "it cannot be read", expected) from None
    try:
        lines = [
            json.loads(line, object_pairs_hook=json_object, parse_constant=no_number) for line in text.splitlines()
        ]
        head, last = lines[0], lines[-1]
        version, digest = head.pop(key), last.pop("sha256")
        if last or len(lines) < 2:
            raise ValueError
        current = type(version) is int and version == readable
        content = parse(head, lines[1:-1]) if current else None
    except InputError:
        raise
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise InputError(str(path), f"it is no {kind}, or not whole", expected) from None
    if content is None:
        raise InputError(str(path), f"it is of version {_short(version)}", f"version {readable}")
    body = text[: text.rstrip(b"\n").rfind(b"\n") + 1]
    if hashlib.sha256(body).hexdigest() != digest:
        raise InputError(str(path), "its digest is not that of its lines", "a certificate as it was written")
    return content


def read(path: Path) -> tuple[Claim, list[Reason]]:
    """Read a certificate without checking scene and reasons; InputError if it is damaged."""

    def parse(head: dict[str, Any], lines: list[Any]) -> tuple[Claim, list[Reason]]:
        if not isinstance(head["scene"], dict):
            raise ValueError
        reasons = list(_reasons(lines))
        return _claim(head, str(path)), reasons

    return read_lines(path, _KEY, _EXPECTED, VERSION, parse)


def _claim(head: dict[str, Any], path: str) -> Claim:
    """Return the claim of a first line without its version; raise InputError if it is invalid."""
    for name in (*Claim.__dataclass_fields__, *head):
        if (name in head) != (name in Claim.__dataclass_fields__):
            how = "is unknown" if name in head else "is missing"
            raise InputError(path, f"the key {name!r} of its first line {how}", _EXPECTED)
    numbers = {"bound": finite(head["bound"])}
    if numbers["bound"] is None:
        raise InputError(path, f"its bound {_short(head['bound'])} is no finite number", "a load factor")
    labelling, load = head["labelling"], head["load_factor"]
    if load is not None:
        numbers["load_factor"] = finite(load)
        if numbers["load_factor"] is None:
            raise InputError(path, f"its load_factor {_short(load)} is no finite number", "a load factor, or null")
        if numbers["load_factor"] > numbers["bound"]:
            problem = f"the layout it names carries {load!r}, above its own bound {head['bound']!r}"
            raise InputError(path, problem, "a load_factor of at most the bound")
    if labelling is not None and (not isinstance(labelling, str) or set(labelling) - {"d", "i"}):
        raise InputError(path, f"its labelling {_short(labelling)} is none", "letters d and i, or null")
    if (labelling is None) != (load is None):
        raise InputError(path, "of labelling and load_factor one is null", "both, or neither")
    if not isinstance(head["made_by"], str):
        raise InputError(path, f"its made_by {_short(head['made_by'])} is no text", "the name of a program")
    return Claim(**{**head, **numbers})


def finite(value: object) -> float | None:
    """Return the double nearest to a JSON number; None for anything else, or beyond doubles."""
    if type(value) not in (int, float):
        return None
    try:
        number = float(value)  # type: ignore[arg-type]
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def json_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; raise ValueError for repeated keys, which are ambiguous."""
    entries = dict(pairs)
    if len(entries) < len(pairs):
        raise ValueError
    return entries


def no_number(name: str) -> float:
    """Convert NaN and Infinity, which Python writes but JSON does not allow, to a float."""
    return float(name)


def _short(value: object) -> str:
    """Return a value as text of at most 40 characters for an error message."""
    text = repr(value)
    return text if len(text) <= 40 else text[:37] + "..."


def _reasons(lines: list[dict[str, Any]]) -> Iterator[Reason]:
    """Yield the reasons of all lines; raise ValueError for an invalid line."""
    for line in lines:
        if "moves" in line:
            if line.keys() != {"dry", "inner", "case", "digits", "moves"}:
                raise ValueError
            moves = {int(element): numbers_of(velocity) for element, velocity in line["moves"].items()}
            case, digits = numbers_of([line["case"], line["digits"]])
            if not 0 <= digits < MOST_DIGITS or [str(element) for element in moves] != list(line["moves"]):
                raise ValueError
            yield Mechanism(numbers_of(line["dry"]), numbers_of(line["inner"]), case, digits, moves)
        elif "walls" in line:
            tables = {}
            for name in ("walls", "prices"):
                tables[name] = {int(key): numbers_of(values) for key, values in line[name].items()}
                if [str(key) for key in tables[name]] != list(line[name]):
                    raise ValueError
            case, digits = numbers_of([line["case"], line["digits"]])
            blocks = {numbers_of(members): numbers_of(velocity) for members, velocity in line["blocks"]}
            if line.keys() != BlockMechanism.__dataclass_fields__.keys() or not 0 <= digits < MOST_DIGITS:
                raise ValueError
            labels = numbers_of(line["dry"]), numbers_of(line["inner"])
            yield BlockMechanism(*labels, case, digits, tables["walls"], tables["prices"], blocks)
        elif "lemma" in line:
            if line.keys() != {"lemma", "by"}:
                raise ValueError
            yield Lemma(numbers_of(line["lemma"]), numbers_of(line["by"]))
        else:
            ((kind, numbers),) = line.items()
            yield Rule(kind, numbers_of(numbers))


def numbers_of(values: list[Any]) -> tuple[int, ...]:
    """Return a list of integers as a tuple; raise ValueError for anything else."""
    if not isinstance(values, list) or any(type(value) is not int for value in values):
        raise ValueError
    return tuple(values)


def at_least(literals: Sequence[int], least: int, top: int) -> tuple[list[list[int]], int]:
    """Return clauses for "at least `least` literals are true", and the largest variable used."""
    # Variable (i, j) states that j of the first i literals are true. It implies (i − 1, j), or (i − 1, j − 1) together
    # with literal i. One direction of the implication suffices, since the constraint is only a lower bound.
    if least > len(literals):
        return [[]], top
    previous: list[int | None] = [None] * (least + 1)  # (0, j) is false for every j > 0
    clauses: list[list[int]] = []
    for position, literal in enumerate(literals, 1):
        current: list[int | None] = [None] * (least + 1)
        for j in range(1, min(position, least) + 1):
            top += 1
            current[j] = top
            fewer = previous[j]
            same = [] if fewer is None else [fewer]
            clauses.append([-top, *same, literal])
            if j > 1:
                one_less = previous[j - 1]
                clauses.append([-top, *same, *([] if one_less is None else [one_less])])
        previous = current
    last = previous[least]
    if last is None:
        raise ValueError("a constraint on no literal needs no clauses; least must be 1 or more")
    return [*clauses, [last]], top
