"""Read and write certificates of proofs over boxes: JSON lines with claim, tree, digest."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jld_core import InputError
from jld_explore.verification import certificate

VERSION: Final = 1  # version of the file format

KEY: Final = "jld box certificate"  # key of the version in the first line

# Remedy in error messages about a damaged certificate
_EXPECTED: Final = "a certificate as jld move --prove --certificate writes it"

Pair = tuple[float, float]  # a point, a displacement, or the ends of an interval


@dataclass(frozen=True)
class BoxClaim:
    """Statement of a certificate: no position in the box carries more than `bound`."""

    scene: dict[str, Any]  # scene with stated interfaces as JSON, not validated; positions are measured from it
    bound: float  # upper bound on λ, scene units; with load cases on the governing factor
    box: tuple[Pair, ...]  # least and greatest value of each parameter, lengths
    # for each parameter the points that it moves, and their displacement for a parameter of one
    directions: tuple[tuple[tuple[Pair, Pair], ...], ...]
    parameters: tuple[float, ...] | None = None  # best position found
    load_factor: float | None = None  # λ that it carries; None if no position was found to stand
    made_by: str = ""  # name of the program that wrote the certificate


@dataclass(frozen=True)
class Split:
    """Node of the tree: the box is split into two along one parameter, the lower half first."""

    axis: int  # index of the parameter
    at: float  # value of the parameter at the common end of both halves, length


@dataclass(frozen=True)
class Leaf:
    """Node of the tree: a mechanism that bounds λ of all positions in the box."""

    case: int  # position of the load case
    digits: int  # binary digits of the velocities after the point
    # velocities (ux, uy, ω) of elements as integers over 2**digits: a point (x, y) of the plane has the velocity (ux −
    # ω y, uy + ω x)
    moves: dict[int, tuple[int, ...]]


Node = Split | Leaf


def write(path: Path, claim: BoxClaim, nodes: Iterable[Node]) -> None:
    head = {KEY: VERSION, **{name: value for name, value in vars(claim).items() if name != "scene"}}
    lines = [{**head, "scene": claim.scene}, *(_line(node) for node in nodes)]
    certificate.write_lines(path, lines)


def _line(node: Node) -> dict[str, Any]:
    if isinstance(node, Split):
        return {"split": node.axis, "at": node.at}
    moves = {str(element): velocity for element, velocity in node.moves.items()}
    return {"case": node.case, "digits": node.digits, "moves": moves}


def read(path: Path) -> tuple[BoxClaim, list[Node]]:
    """Read a certificate without checking scene and tree; InputError if it is damaged."""
    try:
        text = path.read_bytes()
    except (OSError, ValueError) as error:
        raise InputError(str(path), getattr(error, "strerror", None) or "it cannot be read", _EXPECTED) from None
    try:
        lines = [
            json.loads(line, object_pairs_hook=certificate.json_object, parse_constant=certificate.no_number)
            for line in text.splitlines()
        ]
        head, last = lines[0], lines[-1]
        version, digest = head.pop(KEY), last.pop("sha256")
        if last or len(lines) < 2 or type(version) is not int:
            raise ValueError
        known = version == VERSION and head.keys() == BoxClaim.__dataclass_fields__.keys()
        claim, nodes = (_claim(head), [_node(line) for line in lines[1:-1]]) if known else (None, [])
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError):
        raise InputError(str(path), "it is no certificate of a box, or not whole", _EXPECTED) from None
    if version != VERSION:
        raise InputError(str(path), f"it is of version {version}", f"version {VERSION}")
    if claim is None:
        raise InputError(str(path), "the keys of its first line are not those of a certificate", _EXPECTED)
    body = text[: text.rstrip(b"\n").rfind(b"\n") + 1]
    if hashlib.sha256(body).hexdigest() != digest:
        raise InputError(str(path), "its digest is not that of its lines", "a certificate as it was written")
    return claim, nodes


def _claim(head: dict[str, Any]) -> BoxClaim:
    """Read the claim of a first line without its version; raise ValueError if it is invalid."""
    if not isinstance(head["scene"], dict) or not isinstance(head["made_by"], str):
        raise ValueError
    box = tuple(_pair(ends) for ends in head["box"])
    directions = tuple(tuple((_pair(point), _pair(way)) for point, way in motion) for motion in head["directions"])
    found = head["load_factor"]
    best = None if head["parameters"] is None else tuple(_number(value) for value in head["parameters"])
    if not box or len(directions) != len(box) or any(low >= high for low, high in box):
        raise ValueError
    if (found is None) != (best is None) or (best is not None and len(best) != len(box)):
        raise ValueError
    load_factor = None if found is None else _number(found)
    return BoxClaim(head["scene"], _number(head["bound"]), box, directions, best, load_factor, head["made_by"])


def _node(line: dict[str, Any]) -> Node:
    """Read a node; raise ValueError for an invalid line."""
    if line.keys() == {"split", "at"}:
        (axis,) = certificate.numbers_of([line["split"]])
        return Split(axis, _number(line["at"]))
    if line.keys() != {"case", "digits", "moves"}:
        raise ValueError
    case, digits = certificate.numbers_of([line["case"], line["digits"]])
    moves = {int(element): certificate.numbers_of(velocity) for element, velocity in line["moves"].items()}
    if not 0 <= digits < certificate.MOST_DIGITS or [str(element) for element in moves] != list(line["moves"]):
        raise ValueError
    if any(len(velocity) != 3 for velocity in moves.values()):
        raise ValueError
    return Leaf(case, digits, moves)


def _number(value: object) -> float:
    """Return a finite number; raise ValueError for anything else."""
    found = certificate.finite(value)
    if found is None:
        raise ValueError
    return found


def _pair(values: object) -> Pair:
    """Return two finite numbers; raise ValueError for anything else."""
    if not isinstance(values, list) or len(values) != 2:
        raise ValueError
    return _number(values[0]), _number(values[1])
