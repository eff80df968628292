"""Bad scenes and bad options: one clear line, exit code 2, nothing printed, nothing written.

Each scene is a valid one with one thing wrong in it, and each expectation names what the line must say: the key
or element, what is wrong, what is expected.
"""

from __future__ import annotations

import copy
import json
import os
import random
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cases import grid_document
from command import Command, Outcome, process
from jld_core import InputError, Status, build_assembly, parse_scene, solve
from jld_explore import ExploreSettings, explore, search_space
from jld_explore.report import words as words_of_report

Document = dict[str, Any]
GONE: Any = object()
Key = str | int


def wall() -> Document:
    return grid_document(["aab", "abb", "###"])


def two_blocks() -> Document:
    ground = [[-1, -1], [3, -1], [3, 0], [-1, 0]]
    return {
        "elements": [
            {"id": "s", "polygon": ground, "support": True},
            {"id": "a", "polygon": [[0, 0], [1, 0], [1, 1], [0, 1]], "weight": 1},
            {"id": "b", "polygon": [[1, 0], [2, 0], [2, 1], [1, 1]], "weight": 1},
        ],
        "materials": {"dry": {"friction_coefficient": 0.5}, "inner": {"tensile_strength": 1, "shear_strength": 1}},
        "loads": {"live": [{"body": [1, 0]}]},
    }


def cube(name: str, height: float, **more: Any) -> Document:
    corners = [[0, 0], [1, 0], [1, 1], [0, 1]]
    vertices = [[x, y, height + z] for z in (0, 1) for x, y in corners]
    faces = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]
    return {"id": name, "vertices": vertices, "faces": faces, **more}


def two_cubes() -> Document:
    return {
        "elements": [cube("s", 0.0, support=True), cube("a", 1.0, density=2000)],
        "materials": {
            "gravity": [0, 0, -9.81],
            "dry": {"friction_coefficient": 0.5},
            "inner": {"tensile_strength": 1e4, "shear_strength": 1e4},
        },
        "loads": {
            "dead": [{"element": "a", "force": [0, 0, -1]}],
            "live": [{"element": "a", "force": [1, 0, 0], "at": [0, 0, 2], "moment": [0, 0, 1]}],
        },
    }


def changed(document: Document, path: tuple[Key, ...], value: Any) -> Document:
    """A copy with one node replaced, or removed where the value is GONE."""
    document = copy.deepcopy(document)
    node: Any = document
    for key in path[:-1]:
        node = node[key]
    if value is GONE:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return document


INTERFACE = {"elements": ["a", "b"], "polygon": [[1, 0], [1, 1]]}
SUPPORTED = [
    {"elements": ["a", "s"], "polygon": [[0, 0], [1, 0]]},
    {"elements": ["b", "s"], "polygon": [[1, 0], [2, 0]]},
]
PAIR = ["c0r0", "c1r0"]
FAR = ["c0r0", "c2r0"]

# (what is replaced, by what, what the line must hold)
Row = tuple[tuple[Key, ...], Any, tuple[str, ...]]
IN_WALL: list[Row] = [
    # every key of the top level with a value of the wrong kind, or left out
    (("name",), 7, ("name: 7", "a text")),
    (("name",), "", ("name", "0 letters")),
    (("units",), 7, ("units: 7", "an object")),
    (("units",), {"length": 1}, ("units.length: 1", "a text")),
    (("units",), {"mass": "kg"}, ("units.mass", "unknown key", "length, force")),
    (("source",), 7, ("source: 7", "a text")),
    (("notes",), [], ("notes: []", "a text")),
    (("expected",), 7, ("expected: 7", "an object")),
    (("grid",), 7, ("grid: 7", "an object")),
    (("grid",), GONE, ("the geometry is missing", '"grid" and "elements"')),
    (("elements",), two_blocks()["elements"], ("the geometry is given twice",)),
    (("thickness",), "x", ("thickness", '"x"', "a number")),
    (("thickness",), 1.0, ("thickness", 'together with "grid"')),
    (("materials",), 7, ("materials: 7", "an object")),
    (("materials",), GONE, ("materials: missing", '"dry"')),
    (("loads",), 7, ("loads: 7", "an object")),
    (("loads",), GONE, ("loads: missing", '"live"')),
    (("labels",), 7, ("labels: 7", "an object")),
    (("search",), 7, ("search: 7", "an object")),
    (("grids",), 1, ("grids: unknown key", '"grid", or another of')),
    # grid
    (("grid", "cells"), [1, 1], ("grid.cells: unknown key", '"cell", or another of cell, thickness, rows')),
    (("grid", "cell"), GONE, ("grid.cell: missing", "[width, height]")),
    (("grid", "cell"), [0.1], ("grid.cell: it has 1 entry", "[width, height]")),
    (("grid", "cell"), [0.1, -1], ("grid.cell[1]: -1", "a number above 0")),
    (("grid", "cell"), ["a", 1], ("grid.cell[0]", "a number")),
    (("grid", "thickness"), 0, ("grid.thickness: 0", "a number above 0")),
    (("grid", "rows"), GONE, ("grid.rows: missing", "a list of texts")),
    (("grid", "rows"), [], ("grid.rows", "0 entries")),
    (("grid", "rows"), "aa", ("grid.rows", "a list of texts")),
    (("grid", "rows"), ["aa", "a"], ("grid.rows: row 1 has 1 cells", "2 as in row 0")),
    (("grid", "rows"), ["a1", "##"], ("grid.rows: row 0 holds '1'", "letters")),
    (("grid", "rows"), ["a a", "###"], ("grid.rows: row 0 holds ' '", "letters")),
    (("grid", "rows"), ["aa"], ("grid.rows", "no cell is a support", "'#'")),
    (("grid", "rows"), ["##"], ("grid.rows", "no free cell")),
    (("grid", "rows"), ["a.", "..", "#a"], ("element 'c0r0'", "no path of interfaces", "to a support")),
    # materials
    (("materials", "dry"), GONE, ("materials.dry: missing", "c0r0–c1r0")),
    (("materials", "inner"), GONE, ("materials.inner: missing", "c0r0–c1r0")),
    (("materials", "density"), -1, ("materials.density: -1", "at least 0")),
    (("materials", "gravity"), "g", ("materials.gravity", "a number or a vector")),
    (("materials", "gravity"), None, ("materials.gravity: null", "a number or a vector")),
    (("materials", "gravity"), [0, 0, -9], ("materials.gravity: it has 3 numbers", "a vector of 2")),
    (("materials", "gravity"), [1], ("materials.gravity: it has 1 entry",)),
    (("materials", "dry"), {}, ("materials.dry: friction is missing", "exactly one of")),
    (
        ("materials", "dry"),
        {"friction_angle": 30, "friction_coefficient": 0.5},
        ("materials.dry: friction is given twice", "exactly one of"),
    ),
    (("materials", "dry"), {"friction_angle": 90}, ("materials.dry.friction_angle: 90", "below 90")),
    (("materials", "dry"), {"friction_coefficient": -0.1}, ("friction_coefficient: -0.1", "at least 0")),
    (("materials", "dry", "cohesive"), 1, ("materials.dry.cohesive: unknown key", "cohesion")),
    (("materials", "inner", "tensile_strength"), -1, ("tensile_strength: -1", "at least 0")),
    (("materials", "inner", "shear_strength"), GONE, ("materials.inner.shear_strength: missing", "a stress")),
    (("materials", "inner", "compressive_strength"), 0, ("compressive_strength: 0", "above 0")),
    # loads
    (("loads", "live"), GONE, ("loads.live: missing", "λ")),
    (("loads", "live"), [], ("loads.live", "the live load is zero")),
    (("loads", "live"), {}, ("loads.live: {}", "a list")),
    (("loads", "live"), [{"body": [0, 0]}], ("loads.live", "the live load is zero")),
    (("loads", "live"), [{"element": "c0r0", "force": [0, 1]}, {"element": "c0r0", "force": [0, -1]}], ("zero",)),
    (("loads", "live"), [{"element": "c0r0", "force": [0, 0]}], ("loads.live", "the live load is zero")),
    (("loads", "live"), [{"element": "c0r0"}], ("loads.live[0]: it does nothing", '"force" or "moment"')),
    (("loads", "live"), [{"force": [1, 0]}], ("loads.live[0].element: missing", "the id")),
    (
        ("loads", "live"),
        [{"element": "c9r0", "force": [0, 1]}],
        ("live[0].element", "'c9r0'", "such as c2r0, c1r0, c0r0"),
    ),
    (("loads", "live"), [{"element": "c0r2", "force": [0, 1]}], ("'c0r2' is a support", "a free element")),
    (("loads", "live"), [{"element": "c0r0", "force": [0, 1, 2]}], ("loads.live[0].force: it has 3 numbers", "2")),
    (("loads", "live"), [{"element": "c0r0", "force": [0]}], ("loads.live[0].force: it has 1 entry",)),
    (("loads", "live"), [{"element": "c0r0", "moment": [1, 2, 3]}], ("loads.live[0].moment", "3 numbers")),
    (("loads", "live"), [{"element": "c0r0", "moment": "x"}], ("loads.live[0].moment", "a number")),
    (("loads", "live"), [{"element": "c0r0", "moment": 1, "at": [0, 0]}], ("loads.live[0].at", "a force")),
    (("loads", "live"), [{"element": "c0r0", "force": [0, 1], "at": [1]}], ("loads.live[0].at: it has 1 entry",)),
    (("loads", "live"), [7], ("loads.live[0]: 7", "an object")),
    (("loads", "live"), [{"body": "x"}], ("loads.live[0].body", "a vector")),
    (("loads", "live"), [{"body": [1, 0, 0]}], ("loads.live[0].body: it has 3 numbers", "2")),
    (("loads", "live"), [{"body": [1, 0], "force": [0, 1]}], ("loads.live[0]", '"force" is given together with')),
    (("loads", "live"), [{"elment": "c0r0", "force": [0, 1]}], ("loads.live[0].elment: unknown key", '"element"')),
    (("loads", "dead"), 5, ("loads.dead: 5", "a list")),
    (("loads", "dead"), [{"element": "c0r2", "force": [0, 1]}], ("loads.dead[0].element", "is a support")),
    # labels
    (("labels",), {"default": "wet"}, ('labels.default: "wet"', '"dry" or "inner"')),
    (("labels",), {"inner": [FAR]}, ("labels.inner[0]: 'c0r0' and 'c2r0' share no interface", "touch")),
    (("labels",), {"inner": [["c0r0"]]}, ("labels.inner[0]: it has 1 entry", "2")),
    (("labels",), {"dry": [["c0r0", "q"]]}, ("labels.dry[0]", "'q'", "ids of two elements")),
    (("labels",), {"inner": [PAIR], "dry": [PAIR[::-1]]}, ("labels", "both inner and dry")),
    # search
    (("search",), {"block_cell": [1, 2]}, ("search.block_cell: unknown key", '"block_cells"')),
    (("search",), {"candidates": []}, ("search.candidates: no face is a candidate",)),
    (("search",), {"candidates": "some"}, ('search.candidates: "some"', "inside-blocks", "a list of pairs")),
    (("search",), {"candidates": 5}, ("search.candidates: 5", "a list of pairs")),
    (("search",), {"candidates": [["c0r0", 3]]}, ("search.candidates[0][1]: 3", "a text")),
    (("search",), {"candidates": [FAR]}, ("search.candidates[0]", "share no interface")),
    (("search",), {"candidates": [["c0r0", "c0r0"]]}, ("search.candidates[0]", "named twice")),
    (("search",), {"keep": {"wet": []}}, ("search.keep.wet: unknown key", "dry, inner")),
    (("search",), {"keep": {"dry": [PAIR], "inner": [PAIR]}}, ("search.keep", "'c0r0', 'c1r0'", "both dry and inner")),
    (("search",), {"keep": {"inner": [FAR]}}, ("search.keep.inner[0]", "share no interface")),
    (
        ("search",),
        {"keep": {"dry": [PAIR], "inner": [["c0r0", "c0r1"], ["c0r1", "c1r1"], ["c1r1", "c1r0"]]}},
        ("search.keep.dry", "fixed dry inside a block"),
    ),
    (("search",), {"candidates": [PAIR], "keep": {"inner": [PAIR]}}, ("search.candidates", "no face is a candidate")),
    (("search",), {"segmentation": "yes"}, ('search.segmentation: "yes"', "true or false")),
    (("search",), {"block_cells": [3, 2]}, ("search.block_cells: the least, 3, is above the most, 2",)),
    (("search",), {"block_cells": [1]}, ("search.block_cells: it has 1 entry",)),
    (("search",), {"block_cells": [1.5, 2]}, ("search.block_cells[0]: 1.5", "a whole number")),
    (("search",), {"block_cells": [7, None]}, ("search.block_cells: the least is 7", "6 free elements")),
    (("search",), {"block_cells": [4, 4]}, ("search.block_cells", "no number of blocks fits")),
    (("search",), {"block_weight": [-1, None]}, ("search.block_weight[0]: -1", "at least 0")),
    (("search",), {"block_weight": [None, 1e-3]}, ("search.block_weight: the most is 0.001",)),
    (("search",), {"block_extent": [9, None]}, ("search.block_extent: the least is 9",)),
    (("search",), {"blocks": [9, None]}, ("search.blocks: [9, null]", "1 to 6")),
    (("search",), {"except": ["nowhere"]}, ("search.except[0]: 'nowhere' names no element", "free element")),
    (("search",), {"except": "c0r0"}, ('search.except: "c0r0"', "a list of ids")),
    (("search",), {"except_": []}, ("search.except_: unknown key", '"except"')),
    (("search",), {"blocks": "two"}, ('search.blocks: "two"', "a list")),
    (("search",), {"dry_faces": [99, None]}, ("search.dry_faces: [99, null]", "0 to 7")),
    (("search",), {"dry_faces": [None, 2], "blocks": [6, 6]}, ("search", "satisfies the constraints")),
    (("search",), {"symmetry": "mirror"}, ('search.symmetry: "mirror"', '"mirror-x"')),
    (("search",), {"symmetry": "mirror-x"}, ("search.symmetry", "no mirror-x symmetry", '"auto"')),
    (("search",), {"front": {"count": "x"}}, ('search.front.count: "x"', "dry_length")),
    (("search",), {"front": {"counts": ["blocks", "x"]}}, ('search.front.counts[1]: "x" is no count',)),
    (("search",), {"front": {"counts": ["blocks"]}}, ("search.front.counts: it has 1 entry", "two names of counts")),
    (("search",), {"front": {"counts": ["blocks", "blocks"]}}, ("search.front.counts: 'blocks' is given twice",)),
    (
        ("search",),
        {"front": {"counts": ["blocks", "shapes"], "count": "shapes"}},
        ("search.front.count: it is given together",),
    ),
    (("search",), {"front": {"sense": ["max", "min"]}}, ("search.front.sense: it has 2 entries",)),
    (("search",), {"front": {"sense": 1}}, ("search.front.sense: 1", '"max" or "min"')),
    # numbers that are JSON and yet of no use, and text that cannot be written
    (("materials", "density"), 1e300, ("materials.density: 1e+300", "a magnitude from")),
    (("materials", "density"), 10**400, ("materials.density", "401 digits", "a magnitude from")),
    (("grid", "cell"), [1e-200, 1], ("grid.cell[0]: 1e-200", "a magnitude from")),
    (("name",), "half \ud800", ("name", "unpaired surrogate")),
    (("a\n\u001b[31mb",), 1, ('"a\\n\\u001b[31mb": unknown key',)),
]
IN_BLOCKS: list[Row] = [
    (("elements",), 7, ("elements: 7", "a list")),
    (("elements",), [], ("elements", "0 entries")),
    (("elements", 0), 3, ("elements[0]: 3", "an object")),
    (("elements", 1, "polygn"), [], ("elements[1].polygn: unknown key", '"polygon"')),
    (("elements", 1, "polygon"), GONE, ("elements[1]", '"polygon"', "neither is given")),
    (("elements", 1, "polygon"), [[0, 0], [1, 1], [1, 0], [0, 1]], ("element 'a'", "self-intersection")),
    (("elements", 1, "polygon"), [[0, 0], [1.5, 0], [1.5, 1], [0, 1]], ("'a' and 'b'", "they overlap")),
    (("elements", 1, "polygon"), [[0.2, 0], [0.4, 0], [0.4, -0.3], [0.2, -0.3]], ("'s' and 'a'", "overlap")),
    (("elements", 1, "polygon"), [[0, 0], [1, 0], [2, 0]], ("element 'a'", "no area")),
    (("elements", 1, "polygon"), [[0, 0], [1, 0], [0, 0], [1, 0]], ("element 'a'", "no area")),
    (("elements", 1, "polygon"), [[2, 2], [2, 2], [2, 2]], ("element 'a'", "no area")),
    (("elements", 1, "polygon"), [[0, 0], [1, 0]], ("elements[1].polygon: it has 2 entries", "at least 3")),
    (("elements", 1, "polygon", 2), [1, 1, 1], ("elements[1].polygon[2]: it has 3 entries", "at most 2")),
    (("elements", 1, "polygon", 2), [1, "x"], ("elements[1].polygon[2][1]", "a number")),
    (
        ("elements", 1, "polygon"),
        [[0, 5], [1, 5], [1, 6], [0, 6]],
        ("element 'a'", "no path of interfaces", "to a support"),
    ),
    (("elements", 1, "polygon"), [[0, 1], [-1, 1], [-1, 0.01]], ("element 'a'", "no path of interfaces")),
    (("elements", 1, "id"), "b", ("elements[2].id: 'b' is used twice",)),
    (("elements", 1, "id"), "", ("elements[1].id: it has 0 letters",)),
    (("elements", 1, "id"), 4, ("elements[1].id: 4",)),
    (("elements", 1, "id"), GONE, ("elements[1].id: missing",)),
    (("elements", 1, "weight"), -1, ("elements[1].weight: -1", "at least 0")),
    (("elements", 1, "volume"), 0, ("elements[1].volume: 0", "above 0")),
    (("elements", 1, "support"), "yes", ('elements[1].support: "yes"', "true or false")),
    (("elements", 0, "support"), False, ("elements: none of them is a support",)),
    (("elements", 1, "centroid"), [1, 2, 3], ("elements[1].centroid: it has 3 numbers", "2")),
    (("elements", 1), cube("a", 0.0), ("elements[1]: it is spatial", "one dimension")),
    (("elements", 1, "faces"), [[0, 1, 2]] * 4, ('elements[1]: "faces" is given alone',)),
    (("elements", 1, "vertices"), cube("a", 0.0)["vertices"], ("elements[1]", "both are given")),
    (("thickness",), 0, ("thickness: 0", "above 0")),
    (("interfaces",), 7, ("interfaces: 7", "a list")),
    (("interfaces",), [], ("element 'a'", "no path of interfaces")),
    (("interfaces",), [{**INTERFACE, "labell": "dry"}], ("interfaces[0].labell: unknown key", '"label"')),
    (("interfaces",), [{**INTERFACE, "label": "wet"}], ('interfaces[0].label: "wet"', '"dry" or "inner"')),
    (("interfaces",), [{**INTERFACE, "polygon": [[1, 0]]}], ("interfaces[0].polygon: it has 1 entry",)),
    (("interfaces",), [{**INTERFACE, "polygon": [[1, 0], [1, 0]]}], ("interfaces[0].polygon", "no length")),
    (("interfaces",), [{**INTERFACE, "polygon": [[1, 0, 0], [1, 1, 1]]}], ("interfaces[0].polygon", "two")),
    (("interfaces",), [{**INTERFACE, "elements": ["a", "a"]}], ("interfaces[0].elements", "named twice")),
    (("interfaces",), [{**INTERFACE, "elements": ["a", "zz"]}], ("interfaces[0].elements", "'zz'")),
    (("interfaces",), [{**INTERFACE, "elements": ["a"]}], ("interfaces[0].elements: it has 1 entry",)),
    (
        ("interfaces",),
        [{**INTERFACE, "friction_angle": 1, "friction_coefficient": 1}, *SUPPORTED],
        ("interfaces[0]: friction is given twice",),
    ),
    (("interfaces",), [*SUPPORTED[:1]], ("element 'b'", "no path of interfaces")),
]
IN_CUBES: list[Row] = [
    (("elements", 1, "faces"), GONE, ('elements[1]: "vertices" is given alone',)),
    (("elements", 1, "faces", 0), [0, 1, 9], ("elements[1].faces", "vertex 9", "0 to 7")),
    (("elements", 1, "faces", 0), [0, 1], ("elements[1].faces[0]: it has 2 entries",)),
    (("elements", 1, "vertices", 0), [0, 0], ("elements[1].vertices[0]: it has 2 entries",)),
    (("elements", 0), two_blocks()["elements"][0], ("elements[1]: it is spatial", "one dimension")),
    (("loads", "live", 0, "force"), [1, 0], ("loads.live[0].force: it has 2 numbers", "3")),
    (("loads", "live", 0, "moment"), 2.0, ("loads.live[0].moment: it has 1 numbers", "3")),
    (("materials", "gravity"), [0, -9.81], ("materials.gravity: it has 2 numbers", "a vector of 3")),
]


def cases() -> Iterator[Any]:
    for base, rows in ((wall, IN_WALL), (two_blocks, IN_BLOCKS), (two_cubes, IN_CUBES)):
        for path, value, words in rows:
            shown = "GONE" if value is GONE else ascii(value)[:30]
            key = ".".join(ascii(k).strip("'") for k in path)
            yield pytest.param(base(), path, value, words, id=f"{base.__name__}-{key}-{shown}")


def complaint(outcome: Outcome, *words: str) -> None:
    """Exit code 2, an empty stdout, and one line that holds the words in order."""
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.endswith("\n")
    assert outcome.err.count("\n") == 1
    assert "Traceback" not in outcome.err
    assert "; expected " in outcome.err
    assert "Input should" not in outcome.err
    assert "docs/" not in outcome.err
    place = 0
    for word in words:
        found = outcome.err.find(word, place)
        assert found >= 0, f"{word!r} not in {outcome.err!r} from {place}"
        place = found


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("base", "path", "value", "words"), list(cases()))
def test_bad_scene(
    base: Document, path: tuple[Key, ...], value: Any, words: tuple[str, ...], tmp_path: Path, jld: Command
) -> None:
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_text(json.dumps(changed(base, path, value)))
    outcome = jld("explore", file, "--out", out, "--jobs", "1", "--budget", "1")
    complaint(outcome, f"jld: {file}: ", *words)
    assert not out.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.json"]


@pytest.mark.parametrize("base", [wall, two_blocks, two_cubes])
def test_the_scenes_that_are_spoilt_here_are_good(base: Any) -> None:
    assert solve(build_assembly(parse_scene(base()))).status in Status


def test_a_repeated_last_corner_is_dropped() -> None:
    """Outlines that come closed, first corner given again at the end, are common and harmless."""
    closed = changed(two_blocks(), ("elements", 1, "polygon"), [[0, 0], [1, 0], [1, 1], [1, 1], [0, 1], [0, 0]])
    plain, found = (solve(build_assembly(parse_scene(d))) for d in (two_blocks(), closed))
    assert found.load_factor == pytest.approx(plain.load_factor, rel=1e-12)
    assert len(found.assembly.interfaces) == 3


GOOD = json.dumps(wall()).encode()
FILES: list[tuple[str, bytes, tuple[str, ...]]] = [
    ("empty", b"", ("it is empty", "one JSON object")),
    ("blank", b" \n\n", ("it is empty",)),
    ("not JSON", b"hello", ("it is not JSON", "line 1, column 1")),
    ("truncated", GOOD[:200], ("it is not JSON", "line 1, column")),
    ("binary", bytes(range(256)), ("it is not UTF-8 text",)),
    ("UTF-16", GOOD.decode().encode("utf-16"), ("it is not UTF-8 text",)),
    ("a list", b"[1, 2]", ("it holds [1, 2]", "one JSON object")),
    ("null", b"null", ("it holds null",)),
    ("NaN", GOOD.replace(b"1400", b"NaN"), ("the number NaN", "finite")),
    ("Infinity", GOOD.replace(b"1400", b"-Infinity"), ("the number -Infinity", "finite")),
    ("overflow", GOOD.replace(b"1400", b"1e999"), ("materials.density", "out of range")),
    ("thousands of digits", GOOD.replace(b"1400", b"1" * 5000), ("thousands of digits",)),
    ("twice", GOOD.replace(b'"density"', b'"density": 1, "density"'), ("density", "given twice")),
    ("deep", b"[" * 100_000, ("nested too deeply", "64")),
    ("deep inside", b'{"notes":' + b"[" * 90 + b"]" * 90 + b"}", ("notes", "nested too deeply")),
]


@pytest.mark.parametrize(("content", "words"), [f[1:] for f in FILES], ids=[f[0] for f in FILES])
def test_bad_file(content: bytes, words: tuple[str, ...], tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_bytes(content)
    for command in (["check"], ["solve"], ["explore", "--out", str(out)], ["plot"]):
        complaint(jld(command[0], file, *command[1:]), f"jld: {file}: ", *words)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.json"]


def test_a_byte_order_mark_is_accepted(tmp_path: Path, jld: Command) -> None:
    file = tmp_path / "scene.json"
    file.write_bytes(b"\xef\xbb\xbf" + GOOD)
    assert jld("check", file).code == 0


def test_no_file_and_no_folder(tmp_path: Path, jld: Command) -> None:
    missing, out = tmp_path / "missing.json", tmp_path / "out"
    complaint(jld("explore", missing, "--out", out), f"jld: {missing}: ", "No such file")
    complaint(jld("solve", tmp_path), f"jld: {tmp_path}: ", "a folder written by jld explore")
    complaint(jld("plot", tmp_path), f"jld: {tmp_path}: ", "jld explore")
    assert not any(tmp_path.iterdir())


OPTIONS: list[tuple[list[str], tuple[str, ...]]] = [
    (["--driver", "simplex"], ("--driver", "'simplex'", "enumeration")),
    (["--objective", "stiffness"], ("--objective", "'stiffness'", "associative")),
    (["--budget", "0"], ("--budget", "'0'", "1")),
    (["--budget", "1e3"], ("--budget", "'1e3'", "a whole number")),
    (["--budget=many"], ("--budget", "'many'", "a whole number")),
    (["--seconds", "-1"], ("--seconds", "'-1'", "0")),
    (["--seconds", "nan"], ("--seconds", "'nan'", "0")),
    (["--jobs", "0"], ("--jobs", "'0'", "1")),
    (["--jobs", "100000"], ("--jobs", "100000 processes", "at most")),
    (["--seed", "-1"], ("--seed", "'-1'", "0")),
    (["--seed", "0.5"], ("--seed", "'0.5'", "a whole number")),
    (["--bogus"], ("--bogus", "--help")),
    (["--solver", "abacus"], ("--solver", "'abacus'", "clarabel")),
    (["--gap", "inf"], ("--gap", "inf", "above 0")),
    (["--driver", "anneal", "--chains", "1000000000"], ("--chains", "1000000000", "100000")),
    (["--driver", "genetic", "--population", "1000000000"], ("--population", "1000000000", "1000000")),
]


OF_SOLVE: list[tuple[list[str], tuple[str, ...]]] = [
    (["--solver", "abacus"], ("--solver", "'abacus'", "clarabel")),
    (["--gap", "0"], ("--gap", "0", "above 0")),
    (["--gap", "-1e-6"], ("--gap", "-1e-06", "above 0")),
    (["--gap", "nan"], ("--gap", "nan", "above 0")),
    (["--gap", "small"], ("--gap", "'small'", "a number")),
    (["--friction", "none"], ("--friction",)),
]
BAD = [("explore", *row) for row in OPTIONS] + [("solve", *row) for row in OF_SOLVE]


@pytest.mark.parametrize(("name", "options", "words"), BAD, ids=[" ".join([row[0], *row[1]]) for row in BAD])
def test_bad_option(name: str, options: list[str], words: tuple[str, ...], tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_bytes(GOOD)
    complaint(jld(name, file, "--out", out, *options), "jld: ", *words)
    assert not out.exists()


@pytest.mark.parametrize("line", [[], ["frobnicate"], ["explore"], ["check", "a.json", "b.json"]])
def test_bad_command(line: list[str], jld: Command) -> None:
    complaint(jld(*line), "jld: ", "--help")


def test_places_that_cannot_be_written(tmp_path: Path, jld: Command) -> None:
    file, taken = tmp_path / "scene.json", tmp_path / "taken"
    file.write_bytes(GOOD)
    taken.write_text("mine")
    for command in ("explore", "solve"):
        for out in (taken, taken / "below", taken / "far" / "below"):
            outcome = jld(command, file, "--out", out)
            complaint(outcome, f"jld: {taken}: ", "it is a file", "a folder")
    outcome = jld("plot", file, "--out", tmp_path / "picture.bmp")
    complaint(outcome, "jld: --out", "picture.bmp", ".png")
    outcome = jld("plot", file, "--out", tmp_path / "none" / "picture.png")
    complaint(outcome, str(tmp_path / "none"))
    assert taken.read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.json", "taken"]


def test_folders_that_are_not_a_study(tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_bytes(GOOD)
    out.mkdir()
    (out / "thesis.txt").write_text("mine")
    complaint(jld("explore", file, "--out", out), f"jld: {out}: ", "empty", "--resume")
    outcome = jld("explore", file, "--out", out, "--resume")
    complaint(outcome, f"jld: {out}: ", "nothing to go on with", "jld explore")
    assert [p.name for p in out.iterdir()] == ["thesis.txt"]


DOMINOES = {
    "odd number of cells": ["aaa", "aaa", "aaa", "###"],
    "two corners of one colour gone": ["aaaaa.", "aaaaaa", "aaaaaa", "aaaaaa", "aaaaaa", ".aaaaa", "######"],
}


@pytest.mark.parametrize("rows", DOMINOES.values(), ids=DOMINOES)
@pytest.mark.parametrize("driver", [[], ["--driver", "enumeration"]], ids=["chosen", "enumeration"])
def test_constraints_that_parity_forbids(rows: list[str], driver: list[str], tmp_path: Path, jld: Command) -> None:
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_text(json.dumps(grid_document(rows, block_cells=[2, 2])))
    complaint(jld("explore", file, "--out", out, *driver), f"jld: {file}: search")
    assert not out.exists()


@pytest.mark.parametrize("driver", ["enumeration", "genetic"])
def test_a_space_that_turns_out_empty_leaves_nothing_behind(driver: str, tmp_path: Path) -> None:
    """Where the space is too large to be seen through beforehand, the end of the search is the same."""
    scene = parse_scene(grid_document(DOMINOES["two corners of one colour gone"], block_cells=[2, 2]))
    out = tmp_path / "out"
    said: list[str] = []
    with pytest.raises(InputError, match="search: no labelling satisfies the constraints"):
        explore(scene, out, ExploreSettings(driver=driver, small=0), announce=said.append)
    assert not out.exists()
    assert said == []


def test_as_a_process(tmp_path: Path) -> None:
    """The same through a real process: nothing of Python's own reaches either stream."""
    file, out = tmp_path / "scene.json", tmp_path / "out"
    file.write_text(json.dumps(changed(wall(), ("grid", "rows"), ["aa", "a"])))
    complaint(process("explore", file, "--out", out), f"jld: {file}: grid.rows: ", "row 1 has 1 cells")
    assert not out.exists()


# --- mutation: whatever a file holds, it is a scene or an InputError, never another exception --------------------

MUTATIONS = int(os.environ.get("JLD_MUTATIONS", "40"))
"""Number of mutations of each scene. `make bench` asks for more."""
ODD: list[Any] = [
    *(None, True, False, 0, 1, -1, 2, -7, 0.5, -0.25, 1e-9, 1e9, 1e-29, 1e29, -1e29, 1e300, -1e-300, 10**50),
    *("", "a", "c0r0", "b", "dry", "#", [], {}, [[]], [0, 0], [1, 0], [0, -1], [1, 2, 3], [None]),
    *(["a", "b"], [["a", "b"]], {"a": 1}),
]
FACTORS = (-1.0, 1e-12, 1e12, 1.0000001, 0.999999, 1e25, 1e-25)
RICH: list[Document] = [
    grid_document(
        ["aab", "abb", "###"],
        live=[{"element": "c0r0", "force": [0, -1], "at": [0.1, 0.1], "moment": 0.1}, {"body": [1, 0]}],
        crush_dry=1e6,
        block_cells=[1, 4],
        keep={"dry": [["c0r0", "c0r1"]]},
        front={"count": "blocks"},
    ),
    {
        **two_blocks(),
        "interfaces": [{**INTERFACE, "label": "inner", "tensile_strength": 2}, *SUPPORTED],
        "labels": {"default": "dry", "inner": [["a", "b"]]},
        "thickness": 2.0,
    },
    two_blocks(),
    two_cubes(),
]


def nodes(value: Any, path: tuple[Key, ...] = ()) -> Iterator[tuple[Key, ...]]:
    if path:
        yield path
    keys = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield from nodes(value[key], (*path, key))


def mutated(document: Document, rng: random.Random) -> Document:
    """A document with one to three nodes dropped, renamed, doubled, scaled or replaced by something odd."""
    document = copy.deepcopy(document)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        paths = list(nodes(document))
        if not paths:
            break
        path = rng.choice(paths)
        parent: Any = document
        for key in path[:-1]:
            parent = parent[key]
        key, kind = path[-1], rng.random()
        value = parent[key]
        if kind < 0.12:
            del parent[key]
        elif kind < 0.16 and isinstance(parent, dict):
            parent[rng.choice(["a", "polygon", "weight", "force"])] = parent.pop(key)
        elif kind < 0.22 and isinstance(parent, list):
            parent.append(copy.deepcopy(value))
        elif kind < 0.75 and isinstance(value, int | float) and not isinstance(value, bool):
            parent[key] = value * rng.choice(FACTORS)
        else:
            parent[key] = copy.deepcopy(rng.choice(ODD))
    return document


@pytest.mark.parametrize("base", range(len(RICH)))
def test_mutated_scenes(base: int) -> None:
    """Warnings are errors in these tests, so numbers that overflow on the way would show as well."""
    ended: Counter[str] = Counter()
    for seed in range(MUTATIONS):
        document = mutated(RICH[base], random.Random(7000 * base + seed))
        refused, solved = None, None
        try:
            scene = parse_scene(document, "file")
            assembly = build_assembly(scene)
            text = scene.model_dump_json(exclude_defaults=True)
            solved = solve(assembly)
        except InputError as error:
            refused = error
        if solved is None:
            ended["refused"] += 1
            assert "\n" not in str(refused)
            assert "Input should" not in str(refused)
            assert refused.expected
            continue
        assert parse_scene(json.loads(text)).fingerprint == scene.fingerprint
        ended[solved.status] += 1
        json.dumps(solved.to_json(), allow_nan=False)
        try:
            space = search_space(scene, assembly, allow_empty=True, need_materials=False)
        except InputError:
            ended["nothing to search"] += 1
        else:
            assert words_of_report.assembly(scene, assembly, space)
    # the mutations reach both sides
    assert ended["refused"] > MUTATIONS // 6
    assert ended[Status.COLLAPSE] > MUTATIONS // 30
