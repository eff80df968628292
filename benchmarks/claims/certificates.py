"""Whatever is changed in a certificate: what `jld verify` accepts is true, and its refusals are one line."""

from __future__ import annotations

import hashlib
import json
import math
import random
import tempfile
from pathlib import Path
from typing import Any, Final

from benchmarks.claims.tally import Tally, run_cases
from jld_core.errors import InputError
from jld_core.scene.reading import parse_scene
from jld_explore import ExploreSettings, explore
from jld_explore.verification import verify

CLAIM: Final = "jld verify accepts true claims only and refuses every other file in one line"
_MUTATIONS: Final = 30
_TOLERANCE: Final = 2e-6
"""Share of λ by which the best layout of an enumeration may exceed a bound: width of brackets, gap of proofs."""


def run(first_seed: int, cases: int, seconds: float) -> Tally:
    """Change certificates of random scenes, `_MUTATIONS` times each, and judge what is accepted by enumeration."""
    return run_cases(CLAIM, _case, first_seed, cases, seconds)


def _case(seed: int, tally: Tally) -> str:
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "proof.jld"
        try:
            settings = ExploreSettings(driver="exact", certificate=path, pictures=False, seed=seed)
            explore(parse_scene(_scene(rng)), folder / "out", settings)
        except InputError as error:
            _count(tally, "no certificate")
            # a bound whose mechanisms do not stand in whole numbers, or no layout at all
            return "" if "\n" not in str(error) else f"refused in several lines: {error}"
        whole = path.read_bytes()
        for number in range(_MUTATIONS + 1):
            changed = whole if number == 0 else _changed(whole, rng)
            path.write_bytes(changed)
            problem = _judged(path, folder / f"again{number}", changed == whole, tally)
            if problem:
                return f"mutation {number}: {problem}"
    return ""


def _judged(path: Path, folder: Path, is_whole: bool, tally: Tally) -> str:
    """Return what is wrong with the answer about one file, "" if nothing is."""
    try:
        claim = verify(path).claim
    except InputError as error:
        _count(tally, "refused")
        return "a whole certificate is refused: " + str(error) if is_whole else ""
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    _count(tally, "accepted")
    if not isinstance(claim.bound, int | float) or not math.isfinite(claim.bound):
        return f"the bound {claim.bound!r} is accepted"
    if not isinstance(claim.load_factor, int | float | None):
        return f"the found load factor {claim.load_factor!r} is accepted"
    if claim.load_factor is not None and not claim.load_factor <= claim.bound:
        return f"a found load factor {claim.load_factor} above the bound {claim.bound} is accepted"
    try:
        settings = ExploreSettings(driver="enumeration", pictures=False)
        found = explore(parse_scene(claim.scene), folder, settings).summary.facts
    except InputError:
        return ""  # no layout at all: any bound holds
    best = math.inf if found["unbounded"] else found["best"]
    if best is not None and best > claim.bound + _TOLERANCE * max(abs(claim.bound), 1e-3):
        return f"the bound {claim.bound} is accepted, and a layout carries {best}"
    return ""


def _scene(rng: random.Random) -> dict[str, Any]:
    """Return a random wall of at most six cells on supports."""
    width, height = rng.choice([(2, 1), (3, 1), (2, 2), (3, 2), (2, 3)])
    dry: dict[str, float] = {"friction_coefficient": rng.choice([0.3, 0.75, 1.2])}
    inner: dict[str, float] = {key: rng.choice([1e3, 2e3, 2e4]) for key in ("tensile_strength", "shear_strength")}
    if rng.random() < 0.3:
        dry["compressive_strength"] = inner["compressive_strength"] = rng.choice([2e4, 1e6])
    search: dict[str, Any] = {"block_cells": rng.choice([[1, 2], [1, 3], [2, 4], [None, None]])}
    if rng.random() < 0.2:
        search["segmentation"] = False
    if rng.random() < 0.2:
        search["candidates"] = "all+supports"
    if rng.random() < 0.3:
        search["dry_faces"] = [1, None]
    loads: dict[str, Any] = {"live": [{"body": [1, rng.choice([0, -0.4, 0.3])]}]}
    if rng.random() < 0.2:
        loads = {
            "cases": [{"name": side, "live": [{"body": [sign, 0]}]} for side, sign in (("left", 1), ("right", -1))]
        }
    return {
        "grid": {
            "cell": [rng.choice([0.1, 0.25]), 0.1],
            "thickness": 0.1,
            "rows": ["a" * width] * height + ["#" * width],
        },
        "materials": {"density": 1400, "dry": dry, "inner": inner},
        "loads": loads,
        "search": search,
    }


# --- changes -------------------------------------------------------------------------------------------------


def _changed(whole: bytes, rng: random.Random) -> bytes:
    """Return the file with a few bytes, or one field or line, changed; mostly with the digest that it has then."""
    body = whole[: whole.rstrip(b"\n").rfind(b"\n") + 1]
    if rng.random() < 0.3:
        found = bytearray(body)
        for _ in range(rng.randint(1, 3)):
            place = rng.randrange(len(found))
            found[place : place + rng.randint(0, 2)] = bytes(
                rng.choice(b'0123456789-.,e[]{}":ntfNI\n \xff') for _ in "ab"
            )
        body = bytes(found)
    else:
        lines = [json.loads(line) for line in body.splitlines()]
        _change_lines(lines, rng)
        body = "".join(json.dumps(line) + "\n" for line in lines).encode()
    digest = "0" * 64 if rng.random() < 0.1 else hashlib.sha256(body).hexdigest()
    return body + json.dumps({"sha256": digest}).encode() + b"\n"


def _change_lines(lines: list[Any], rng: random.Random) -> None:
    """Change one field, or leave out, repeat or exchange lines."""
    kind = rng.random()
    place = rng.randrange(len(lines))
    if kind < 0.08:
        del lines[place]
    elif kind < 0.14:
        lines.insert(rng.randrange(len(lines)), lines[place])
    elif kind < 0.2:
        other = rng.randrange(len(lines))
        lines[place], lines[other] = lines[other], lines[place]
    else:
        _change_field(lines[0] if rng.random() < 0.5 else lines[place], rng)


def _change_field(part: Any, rng: random.Random) -> None:
    """Change, remove or add one entry at a random depth of a JSON object or list."""
    while True:
        keys = list(part) if isinstance(part, dict) else list(range(len(part)))
        if not keys:
            return
        key = rng.choice(keys)
        if isinstance(part[key], dict | list) and part[key] and rng.random() < 0.8:
            part = part[key]
            continue
        break
    action = rng.random()
    if action < 0.1:
        del part[key]
    elif action < 0.15 and isinstance(part, list):
        part.append(part[key])
    else:
        part[key] = _other_value(part[key], rng)


def _other_value(value: Any, rng: random.Random) -> Any:
    """Return a value near the given one, or a strange one."""
    near: list[Any] = []
    if isinstance(value, int | float) and not isinstance(value, bool):
        near = [value * 0.999, value * 0.5, value * 2, -value, value + 1, value - 1, round(value), value * (1 - 1e-6)]
    strange: list[Any] = [
        0,
        1,
        -1,
        None,
        math.nan,
        math.inf,
        -math.inf,
        "",
        "a",
        [],
        {},
        10**30,
        1e308,
        5e-324,
        True,
        -0.0,
        [[]],
    ]
    return rng.choice(near if near and rng.random() < 0.7 else strange)


def _count(tally: Tally, name: str) -> None:
    tally.notes[name] = tally.notes.get(name, 0) + 1
