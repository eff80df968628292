"""Solve one scene for labels, materials, loads and vertices that the page requests."""

from __future__ import annotations

import hashlib
import json
import math
import re
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from jld_core import (
    Assembly,
    Bits,
    Floats,
    InputError,
    LimitAnalysisResult,
    Scene,
    build_assembly,
    files,
    load_scene,
    one_thread,
    parse_scene,
)
from jld_core import assembly as structures
from jld_core.build import build_geometry
from jld_core.fields import bounds as fields_bounds
from jld_core.fields import problem as fields_problem
from jld_core.limit import governing, number
from jld_core.models import CaseAnalysis, by_fields
from jld_core.scene import FillLoad, loads, units
from jld_core.scene import cracks as scene_cracks
from jld_core.scene import move as scene_move
from jld_explore import SearchSpace, read_folder, search_space
from jld_explore.report import columns
from jld_explore.space import LETTERS, from_string, reasons_against
from jld_formats import FORMATS
from jld_geometry import MovedScene, TrustRegion, move_joints, vertex_mesh
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.variables import SAME, Variables, mirrored, variables_of, vertex_at
from jld_views import page_contract, page_data, page_of_study
from jld_views import page_data as report_page_data

IMPROVE_SECONDS: Final = 3.0  # time limit of one improvement, s; a page waits for it
STEPS: Final = 6  # number of steps of an improvement that are tried


class JointVertices:
    """Vertices, as in `vertex_mesh`, of one planar scene's faces that the page may move."""

    # Ends of a face that belong to no support move inside freely, and along an outline or circle that the key "move"
    # names.

    def __init__(self, scene: Scene, assembly: Assembly) -> None:
        self._assembly, self._move = assembly, scene.move
        self.mesh: VertexMesh = vertex_mesh(assembly)
        move = (scene.move or scene_move.Move()).model_copy(
            update={"ties": "none", "inner": "stay", "maximise": "load_factor"}
        )
        every = np.ones(len(assembly.interfaces), dtype=bool)
        self._variables: Variables = variables_of(assembly, every, self.mesh, move)
        self._movable = set(self._variables.vertex.tolist())

    def facts(self) -> dict[str, Any]:
        """Return the data by which a page drags vertices: `places`, `loops`, `ends`, `paths` and `ties`."""
        variables, paths = self._variables, dict[str, Any]()
        for vertex in sorted(self._movable):
            rows = np.flatnonzero(variables.vertex == vertex)
            if not np.isnan(variables.centre[rows[0], 0]):
                paths[str(vertex)] = {"circle": variables.centre[rows[0]].tolist()}
            else:
                paths[str(vertex)] = {} if len(rows) > 1 else {"direction": variables.direction[rows[0]].tolist()}
        return {
            "places": self.mesh.places.tolist(),
            "loops": [loop.tolist() for loop in self.mesh.loops],
            "ends": self.mesh.ends.tolist(),
            "paths": paths,
            "ties": {str(vertex): others for vertex, others in sorted(self._tied().items())},
        }

    def _tied(self) -> dict[int, list[tuple[int, int]]]:
        """Return the vertices that move with each by the key "ties", with 1, or −1 for mirrored ones."""
        # Vertices without ties have no entry.
        ties = "none" if self._move is None else self._move.ties
        tied: dict[int, list[tuple[int, int]]] = {}
        if ties == "mirror-x":
            partner = mirrored(self._variables, self._assembly)
            return {k: [(int(partner[k]), -1)] for k in self._movable if partner[k] != k}
        for group in ties if isinstance(ties, list) else []:
            together = [vertex_at(self.mesh.places, point, self._assembly.size, "move.ties") for point in group]
            for vertex in together:
                tied.setdefault(vertex, []).extend((other, 1) for other in together if other != vertex)
        return tied

    def placed(self, vertices: object) -> Floats:
        """Return the places (v, 2) of all vertices, with those of a request; InputError if one may not move."""
        if not isinstance(vertices, dict):
            raise InputError("vertices", "they are no JSON object", "an object from vertex to [x, y]")
        places = self.mesh.places.copy()
        for name, point in vertices.items():
            if not name.isdecimal() or int(name) not in self._movable:
                raise InputError("vertices", f"{name[:40]!r} is no vertex that may move", "a vertex of a joint")
            is_pair = isinstance(point, list) and len(point) == 2
            if not is_pair or not all(type(value) in (int, float) and math.isfinite(value) for value in point):
                raise InputError(f"vertices.{name}", f"it is {str(point)[:40]}", "two finite numbers [x, y]")
            places[int(name)] = point
        return places

    def scene(self, base: Scene, labels: Bits, places: Floats) -> Scene:
        return self.mover(base, labels).at(places)

    def mover(self, base: Scene, labels: Bits) -> MovedScene:
        """Return the factory of the scene with its vertices at given places.

        Arguments as in `scene`.
        """
        return MovedScene(base, self._assembly, labels, self.mesh)

    def improved(self, scene: Scene, assembly: Assembly, labels: Bits, places: Floats) -> dict[str, Any]:
        """Move joints by some steps of `jld move` from places (v, 2): `vertices`, `start`, `value`, `steps`, `end`."""
        # Vertices of inner faces follow where the scene has no key "move". λ is maximised, even if the key states
        # another objective.
        move = (scene.move or scene_move.Move(inner="follow")).model_copy(update={"maximise": "load_factor"})
        moving = scene.model_copy(update={"move": move})
        result = move_joints(moving, assembly, labels, seconds=IMPROVE_SECONDS, trust=TrustRegion(points=STEPS))
        # the mesh of what is shown may number its vertices in another way
        start = result.places - result.moved
        distance, same = cKDTree(start).query(places)
        is_known = np.asarray(distance) <= SAME * assembly.size
        ends = places + np.where(is_known[:, None], result.moved[same], 0.0)
        changed = np.flatnonzero(abs(ends - self.mesh.places).max(axis=1) > 0.0).tolist()
        return {
            "vertices": {str(vertex): ends[vertex].tolist() for vertex in changed if vertex in self._movable},
            "start": number(result.start),
            "value": number(result.value),
            "steps": len(result.points) - 1,
            "end": result.end,
        }


METRIC: Final = ("MN", "kN", "N")  # units of force among which a number chooses the largest in which it is at least 1


def collapse_loads(scene: Scene, assembly: Assembly, result: LimitAnalysisResult) -> list[list[str]]:
    """State λ times every live load: for each case one text per live entry, as "11.9 kN", "" without λ.

    None if moving.
    """
    results = result.cases or {"": result}
    return texts_of_loads(scene, assembly, {name: solved.load_factor for name, solved in results.items()})


def texts_of_loads(scene: Scene, assembly: Assembly, factors: Mapping[str, float | None]) -> list[list[str]]:
    """State a factor times every live load of each case, by its name, as `collapse_loads`."""
    several = scene.loads.has_cases
    entries = {case.name: case.live for case in scene.loads.cases or []} if several else {"": scene.loads.live or []}
    weight = float(np.linalg.norm(assembly.elements.weight[assembly.elements.free], axis=1).sum())
    return [
        [_text(entry, scene, weight, factor) for entry in entries.get(name if several else "", [])]
        for name, factor in factors.items()
    ]


def texts_of_bounds(scene: Scene, assembly: Assembly, brackets: Sequence[Sequence[float | None]]) -> list[list[str]]:
    """State bounds on λ times every live load of each load case, "8.2 kN to 10.6 kN"."""
    # Where one bound is missing or not above 0, the other one is named alone.
    names = [case.name for case in assembly.cases] or [""]
    low, high = (
        texts_of_loads(scene, assembly, {name: one[end] for name, one in zip(names, brackets, strict=True)})
        for end in (0, 1)
    )
    texts = []
    for least, most, (bottom, top) in zip(low, high, brackets, strict=True):
        if top is not None and top <= 0.0:
            texts.append([""] * len(most))
        elif bottom is None or bottom <= 0.0:
            texts.append([text and f"at most {text}" for text in most])
        elif top is None:
            texts.append([text and f"at least {text}" for text in least])
        else:
            texts.append([one if one == two else f"{one} to {two}" for one, two in zip(least, most, strict=True)])
    return texts


def _text(entry: loads.LoadEntry, scene: Scene, weight: float, factor: float | None) -> str:
    """State λ times one live load. weight: of all free elements together. factor: λ, or none."""
    if factor is None or not np.isfinite(factor):
        return ""
    force, length = scene.units.force, scene.units.length
    if isinstance(entry, loads.BodyLoad | loads.TiltLoad):
        return _size(factor * weight * float(np.linalg.norm(entry.body)), force)
    if isinstance(entry, FillLoad):
        return _size(factor * entry.weight, force)
    if isinstance(entry, loads.FaceLoad):
        ends = entry.ends[:1] if entry.ends[0] == entry.ends[1] else entry.ends
        stress = _range([factor * end for end in ends], force, f"/{length}²")
        if scene.dimension == 3:
            return stress
        return f"{_range([factor * scene.plane_thickness * end for end in ends], force, f'/{length}')} ({stress})"
    parts = []
    if entry.force is not None:
        parts.append(_size(factor * float(np.linalg.norm(entry.force)), force))
    if np.any(entry.moment):
        parts.append(_size(factor * float(np.linalg.norm(entry.moment)), force, f"·{length}"))
    return " and ".join(parts)


def _range(values: Sequence[float], unit: str, behind: str) -> str:
    """State one force, or two as a range. behind: text after the unit, such as "/m"."""
    return " to ".join(_size(value, unit, behind) for value in values)


def _size(value: float, unit: str, behind: str = "") -> str:
    """State a force with four digits, metric ones in a unit that fits their size."""
    if unit in METRIC:
        newtons = value * units.NEWTONS[unit]
        unit = next((name for name in METRIC if abs(newtons) >= units.NEWTONS[name]), unit)
        value = newtons / units.NEWTONS[unit]
    return f"{value:.4g} {unit}{behind}".replace("-", "−")


# Time within which the bracket of a layout is refined, s of work; no mesh is begun that is expected to end later.
SECONDS: Final = 2.0

# Longest expected time of one mesh, s: a change of the page waits for the mesh that is being solved.
STEP: Final = 0.6
LARGEST: Final = 3000
"""Triangles of the coarsest mesh above which nothing is bounded: both bounds would take longer than `SECONDS`."""

# Number of layouts whose refinement is kept, so that a layout that is shown again goes on where it stopped.
MOST_BRACKETS: Final = 8


class FieldBracket:
    """Bounds by fields on λ of one layout under all cases, step by step to `gap`; InputError if not by hand."""

    def __init__(self, assembly: Assembly, labels: Bits, gap: float) -> None:
        self._assembly = assembly
        fields_problem.require_planar_fields(assembly)
        self._cases = [fields_bounds.FieldRefinement(case, labels, gap=gap) for case in assembly.by_case]
        largest = max(case.simplices for case in self._cases)
        if largest > LARGEST:
            raise InputError("cracks", f"{largest} triangles are too many to follow by hand", "the command `jld solve`")
        self._bounds: list[fields_bounds.FieldBounds | None] = [None] * len(self._cases)

    def step(self) -> dict[str, Any]:
        """Solve one more mesh in time: bracket, cases, status, triangles, seconds, and `more`."""
        # The mesh belongs to a load case without bounds, or else to the one with the least lower bound over its
        # required factor.
        case = self._next()
        if case is not None:
            self._bounds[case] = self._cases[case].step()
        solved = [bounds for bounds in self._bounds if bounds is not None]
        bracket = governing(
            [by_fields.case_bounds_of(bounds) for bounds in solved], self._assembly.required.tolist()[: len(solved)]
        )
        ready = len(solved) == len(self._bounds)
        return {
            "bracket": [number(bracket.low) if ready else None, number(bracket.high)],
            "cases": [
                [None, None] if each is None else [number(each.lower), number(each.upper)] for each in self._bounds
            ],
            "status": str(bracket.status),
            "triangles": sum(bounds.simplices for bounds in solved),
            "seconds": self._spent,
            "more": self._next() is not None,
        }

    @property
    def _spent(self) -> float:
        return sum(bounds.seconds for bounds in self._bounds if bounds is not None)

    def _next(self) -> int | None:
        """Return the load case whose next mesh is solved; None if all ended or time is too short."""
        for case, bounds in enumerate(self._bounds):
            if bounds is None:
                return case
        lower = [math.inf if case_bounds is None else case_bounds.lower for case_bounds in self._bounds]
        for case in np.argsort(np.array(lower) / self._assembly.required, kind="stable").tolist():
            refinement = self._cases[case]
            wait = refinement.expected - refinement.spent
            if not refinement.ended and wait <= STEP and self._spent + wait <= SECONDS:
                return int(case)
        return None


class FieldBrackets:
    """Store of the `FieldBracket` of each of the last layouts shown; thread-safe.

    One mesh is solved at a time.
    """

    def __init__(self) -> None:
        self._brackets: OrderedDict[tuple[int, bytes], tuple[Assembly, FieldBracket]] = OrderedDict()
        self._lock = threading.Lock()

    def step(self, assembly: Assembly, labels: Bits, gap: float) -> dict[str, Any]:
        """Solve one more mesh of a layout, as `FieldBracket.step`, or return `refused` with the reason."""
        key = (id(assembly), labels.tobytes())
        with self._lock:
            try:
                if key not in self._brackets:
                    # the assembly is kept beside its bracket, so that its id stays its own
                    self._brackets[key] = (assembly, FieldBracket(assembly, labels, gap))
                self._brackets.move_to_end(key)
                while len(self._brackets) > MOST_BRACKETS:
                    self._brackets.popitem(last=False)
                return self._brackets[key][1].step()
            except InputError as error:
                return {"refused": str(error), "more": False}


MOST_SCENARIOS: Final = 16  # number of cached assemblies; the cache key contains all changes except labels
MOST_SPACES: Final = 4  # number of cached search spaces; the key contains limits and weights

# Parts of a scene besides labels that a page may change; "vertices" are those of joints of planar scenes.
CHANGEABLE: Final = ("materials", "loads", "search", "vertices")
_SCENE: Final = "scene"  # name of the scene in messages, which a key of the page does not have


@dataclass(frozen=True)
class ScenarioCache:
    """Scene of one state of the page, with all objects that solve it."""

    scene: Scene  # scene with these materials, loads and vertices
    assembly: Assembly
    space: SearchSpace | None  # search space of the scene, None if the scene cannot be searched, or joints were moved
    refusal: InputError | None  # why the scene cannot be searched
    solver: CaseAnalysis  # solver of all load cases of the scene


class StudioSession:
    """Solver of labellings of one scene, whose materials, loads, limits and joints may change, not its elements."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.document: dict[str, Any] = scene.model_dump(mode="json", exclude_defaults=True)
        self._scenarios: OrderedDict[str, ScenarioCache] = OrderedDict()
        self._lock = threading.RLock()
        self._brackets = FieldBrackets()
        self._geometry = build_geometry(scene)
        self._spaces: OrderedDict[tuple[str, bytes], SearchSpace | InputError] = OrderedDict()
        joints = _joints(scene, self.setup({}).assembly)
        self.joints = joints if isinstance(joints, JointVertices) else None
        self._fixed = joints if isinstance(joints, InputError) else None
        self._mover: tuple[str, MovedScene] | None = None

    def setup(self, changes: Mapping[str, Any]) -> ScenarioCache:
        """Return the scene with changed materials, loads and vertices, ready to be solved."""
        for key in changes:
            if key not in CHANGEABLE:
                raise InputError(key, "the studio does not change it", " or ".join(CHANGEABLE))
        name = json.dumps(changes, sort_keys=True)
        with self._lock:
            if name in self._scenarios:
                self._scenarios.move_to_end(name)
                return self._scenarios[name]
            scene, moved = self._changed(changes)
            assembly = build_assembly(scene, None if moved else self._geometry)
            # a search admits by weights and shapes, which take longer to look at than a drag may last
            answer = None if moved else self._space(scene, assembly)
            space, refusal = (None, answer) if isinstance(answer, InputError) else (answer, None)
            scenario = self._scenarios[name] = ScenarioCache(scene, assembly, space, refusal, CaseAnalysis(assembly))
            while len(self._scenarios) > MOST_SCENARIOS:
                self._scenarios.popitem(last=False)
            return scenario

    def _changed(self, changes: Mapping[str, Any]) -> tuple[Scene, bool]:
        """Return the scene with changes as in `setup`, and True if its vertices moved."""
        plain = {key: value for key, value in changes.items() if key != "vertices"}
        scene = parsed({**self.document, **plain}) if plain else self.scene
        if not changes.get("vertices"):
            return scene, False
        joints = self._movable()
        places, name = joints.placed(changes["vertices"]), json.dumps(plain, sort_keys=True)
        if self._mover is None or self._mover[0] != name:
            self._mover = name, joints.mover(scene, self.setup({}).assembly.labels)
        return self._mover[1].at(places), True

    def edited(self, changes: Mapping[str, Any], part: object) -> dict[str, Any]:
        """Return the new value of a changed part as in a scene file, with numbers for texts.

        InputError names its key.
        """
        if part not in CHANGEABLE[:3]:
            raise InputError("part", f"there is no {str(part)[:40]!r}", ", ".join(CHANGEABLE[:3]))
        setup = self.setup(changes)
        if part == "search" and setup.refusal is not None:
            raise setup.refusal
        value: dict[str, Any] = setup.scene.model_dump(mode="json", exclude_defaults=True).get(str(part), {})
        return value

    def _movable(self) -> JointVertices:
        """Return the vertices that may move; raise InputError, which says why, if there are none."""
        if self.joints is None:
            problem = "no vertex of this scene moves" + (f" ({self._fixed})" if self._fixed else "")
            raise InputError("vertices", problem, "a planar scene with joints that may move")
        return self.joints

    def _space(self, scene: Scene, assembly: Assembly) -> SearchSpace | InputError:
        """Return the search space of a scene, or why there is none; the scene can still be solved."""
        # A space is used again unless limits or weights differ.
        key = scene.search.model_dump_json(), assembly.elements.weight.tobytes()
        if key not in self._spaces:
            try:
                self._spaces[key] = search_space(scene, assembly)
            except InputError as error:
                self._spaces[key] = error
        self._spaces.move_to_end(key)
        while len(self._spaces) > MOST_SPACES:
            self._spaces.popitem(last=False)
        return self._spaces[key]

    def labels(self, letters: object) -> Bits:
        """Convert letters d and i, one per face, to labels (m,), True = dry."""
        assembly = self.setup({}).assembly
        count = assembly.faces
        if not isinstance(letters, str) or len(letters) != count or letters.strip(LETTERS):
            raise InputError("labelling", f"it is {str(letters)[:40]!r}", f"{count} letters d or i")
        return structures.with_members(assembly, from_string(letters))

    @one_thread()
    def solve(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Solve a labelling (letters d and i) under changes, and return JSON data for the page.

        "against", reasons why a search would not admit it, and "candidates", faces that it chooses, are None without a
        space, "unsearched" says why.
        """
        start = time.perf_counter()
        setup = self.setup(changes)
        labels = self.labels(letters)
        result = setup.solver.solve(labels)
        solved = time.perf_counter()
        space, count = setup.space, setup.assembly.faces
        against = None if space is None else reasons_against(space, labels)
        return {
            "solution": page_data.solution_of(result),
            "cases": page_data.cases_of(setup.assembly),
            "loads": page_data.loads_of(setup.assembly),
            "collapse": collapse_loads(setup.scene, setup.assembly, result),
            "bodies": _bodies(setup.assembly),
            "against": against,
            "candidates": None if space is None else space.candidates[:count].tolist(),
            "unsearched": None if setup.refusal is None else str(setup.refusal),
            "seconds": {"solve": solved - start, "total": time.perf_counter() - start},
        }

    def improve(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Move joints by some steps of `jld move` from a state of the page."""
        setup, joints = self.setup(changes), self._movable()
        places = joints.placed(changes.get("vertices") or {})
        return joints.improved(setup.scene, setup.assembly, self.labels(letters), places)

    def fields(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return bounds by fields on λ of a labelling, refined by one mesh at each call."""
        setup, cracks = self.setup(changes), self.scene.cracks
        gap = (
            cracks.gap if isinstance(cracks, scene_cracks.FieldCracks) else scene_cracks.FieldCracks(kind="fields").gap
        )
        bracket = self._brackets.step(setup.assembly, self.labels(letters), gap)
        if "cases" in bracket:
            bracket["collapse"] = texts_of_bounds(setup.scene, setup.assembly, bracket["cases"])
        return bracket

    def scene_with(self, letters: object, changes: Mapping[str, Any]) -> dict[str, Any]:
        setup, labels = self.setup(changes), self.labels(letters)
        if changes.get("vertices"):
            joints = self._movable()
            scene, _ = self._changed({key: value for key, value in changes.items() if key != "vertices"})
            moved = joints.scene(scene, labels, joints.placed(changes["vertices"]))
            return moved.model_dump(mode="json", exclude_defaults=True)
        document = setup.scene.model_dump(mode="json", exclude_defaults=True)
        ids, faces = setup.assembly.elements.ids, structures.faces_of(setup.assembly).interfaces
        pairs: dict[tuple[str, str], set[bool]] = {}
        for a, b, dry in zip(faces.a, faces.b, labels[: len(faces)].tolist(), strict=True):
            pairs.setdefault((ids[a], ids[b]), set()).add(dry)
        mixed = [pair for pair, labels_of_pair in pairs.items() if len(labels_of_pair) > 1]
        if mixed:
            raise InputError("labels", f"the faces between {mixed[0][0]} and {mixed[0][1]} differ", "one label a pair")
        for contact in document.get("interfaces", []):
            contact.pop("label", None)
        document["labels"] = {
            "dry": [list(pair) for pair, labels_of_pair in pairs.items() if labels_of_pair == {True}],
            "inner": [list(pair) for pair, labels_of_pair in pairs.items() if labels_of_pair == {False}],
        }
        written = build_assembly(parse_scene(document))
        if not np.array_equal(written.labels, labels):
            raise InputError("labels", "this scene cannot hold these labels", "labels that no other key overrides")
        return document


def parsed(document: dict[str, Any]) -> Scene:
    try:
        return parse_scene(document, _SCENE)
    except InputError as error:
        raise InputError(error.where.removeprefix(f"{_SCENE}: "), error.problem, error.expected) from None


def _joints(scene: Scene, assembly: Assembly) -> JointVertices | InputError | None:
    """Return the vertices of a scene that may move, or why none may; None in space."""
    if assembly.dimension != 2:
        return None
    try:
        return JointVertices(scene, assembly)
    except InputError as error:
        return error  # the page then has no such tool


def _bodies(assembly: Assembly) -> dict[str, Any]:
    """Return "centroids" and "weights" of all elements, as `structure_of` has them."""
    elements = assembly.elements
    weight = np.linalg.norm(elements.weight, axis=1)
    return {"centroids": columns.rounded(elements.centroid), "weights": columns.rounded(weight, columns.DIGITS)}


# Number of scenes beside the first whose solver stays in memory; others are built again when they are asked for.
MOST_SESSIONS: Final = 6
FOLDER: Final = "scenes"  # folder for the scenes of kept candidates
_NAME: Final = re.compile(r"[0-9a-f]{16}")  # pattern of the name of a scene


class SceneStore:
    """Scenes of the pages by name, a digest of their content; thread-safe. root: kept candidates go there."""

    def __init__(self, first: StudioSession, root: Path) -> None:
        self._first, self._folder = first, root / FOLDER
        self.first_name = _digest(first.document)
        self._documents: dict[str, dict[str, Any]] = {self.first_name: first.document}
        self._sessions: OrderedDict[str, StudioSession] = OrderedDict()
        self._lock = threading.RLock()

    def add(self, scene: Scene) -> str:
        """Keep a scene and return its name; raise InputError if it cannot be built."""
        document = scene.model_dump(mode="json", exclude_defaults=True)
        name = _digest(document)
        with self._lock:
            if name not in self._documents:
                self._remember(name, StudioSession(scene))
                self._documents[name] = document
        return name

    def find(self, name: object) -> StudioSession:
        if name is None or name == self.first_name:
            return self._first
        with self._lock:
            if isinstance(name, str) and name in self._sessions:
                self._sessions.move_to_end(name)
                return self._sessions[name]
            return self._remember(str(name), StudioSession(self._scene(name)))

    def has(self, name: object) -> bool:
        return name in self._documents or self._file(name).exists()

    def write(self, name: object) -> None:
        """Write a scene into the folder of candidates, unless it is the first or exists there."""
        if name in (None, self.first_name) or self._file(name).exists():
            return
        with self._lock:
            document = self.find(name).document
        self._folder.mkdir(parents=True, exist_ok=True)
        files.write_text(self._file(name), json.dumps(document))

    def _file(self, name: object) -> Path:
        """Return the file of a stored scene; raise InputError for an invalid name."""
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise InputError("scene", f"there is none named {str(name)[:60]!r}", "one that the studio has opened")
        return self._folder / f"{name}.json"

    def _scene(self, name: object) -> Scene:
        """Return a scene by its name, from memory or disk; raise InputError where there is none."""
        path = self._file(name)
        if name in self._documents:
            return parse_scene(self._documents[str(name)])
        if not path.exists():
            raise InputError("scene", f"{name} is no longer open", "its file opened again")
        return load_scene(path)

    def _remember(self, name: str, session: StudioSession) -> StudioSession:
        """Keep a solver in memory, and let go of the one not used for longest."""
        self._sessions[name] = session
        while len(self._sessions) > MOST_SESSIONS:
            self._sessions.popitem(last=False)
        return session


def _digest(document: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()[:16]


_CELL: Final = re.compile(r"c(\d+)r(\d+)")  # pattern of the name of a cell of a grid: column and row
_LETTERS: Final = "abcdefghijklmnopqrstuvwxyz"  # letters from which a cell that is no longer a support takes its own


def with_support(document: Mapping[str, Any], element: object, support: object) -> dict[str, Any]:
    """Return a document in which an element is a support, or none; labels of pairs of supports are left out."""
    if not isinstance(support, bool):
        raise InputError("support", f"it is {str(support)[:40]!r}", "true or false")
    if "grid" in document:
        rows = _rows_with_support(document["grid"]["rows"], element, support)
        changed_document = {**document, "grid": {**document["grid"], "rows": rows}}
        supports = {f"c{c}r{r}" for r, row in enumerate(rows) for c, cell in enumerate(row) if cell == "#"}
    else:
        names = [entry["id"] for entry in document["elements"]]
        if element not in names:
            raise _unknown(element)
        changed = [dict(entry) for entry in document["elements"]]
        changed[names.index(element)].pop("support", None)
        if support:
            changed[names.index(element)]["support"] = True
        changed_document = {**document, "elements": changed}
        supports = {entry["id"] for entry in changed if entry.get("support")}
    if "labels" in changed_document:
        free = {
            label: [pair for pair in pairs if not set(pair) <= supports] if isinstance(pairs, list) else pairs
            for label, pairs in changed_document["labels"].items()
        }
        changed_document["labels"] = free
    return changed_document


def _rows_with_support(rows: list[str], element: object, support: bool) -> list[str]:
    cell = _CELL.fullmatch(element) if isinstance(element, str) else None
    column, row = (int(cell[1]), int(cell[2])) if cell else (-1, -1)
    if not (0 <= row < len(rows) and 0 <= column < len(rows[row]) and rows[row][column] != "."):
        raise _unknown(element)
    if support == (rows[row][column] == "#"):
        return list(rows)
    # a cell that is free again is a block of its own: its letter is none of its neighbours'
    beside = ((row - 1, column), (row + 1, column), (row, column - 1), (row, column + 1))
    neighbours = {rows[r][c] for r, c in beside if 0 <= r < len(rows) and 0 <= c < len(rows[r])}
    letter = "#" if support else next(letter for letter in _LETTERS if letter not in neighbours)
    changed = rows[row][:column] + letter + rows[row][column + 1 :]
    return [*rows[:row], changed, *rows[row + 1 :]]


def _unknown(element: object) -> InputError:
    return InputError("element", f"there is none named {str(element)[:60]!r}", "the id of an element of the scene")


def first_data(session: StudioSession, root: Path, study: Path | None) -> page_contract.PageData:
    """Return the data with which the page starts: the table of a study, or the scene with its own labels solved."""
    if study is not None:
        extra = _extra(session, root)
        exploration = read_folder(study)
        data = page_of_study.study_data(exploration, patience=0.5, kind="studio", studio=extra)
        best = exploration.summary.best_labelling
        if data["solutions"] or best is None:
            return data
        # a table by fields holds no forces of rigid elements, which the page begins with
        return {
            **data,
            "solutions": {"0": report_page_data.solution_of(session.setup({}).solver.solve(session.labels(best)))},
        }
    return scene_data(session, root)


def scene_data(session: StudioSession, root: Path) -> page_contract.PageData:
    """Return the page data of a scene with its own labels, solved; arguments are those of `first_data`."""
    setup = session.setup({})
    assembly = setup.assembly
    return report_page_data.page_data(
        kind="studio",
        scene=session.scene,
        assembly=assembly,
        candidates=assembly.free_faces if setup.space is None else setup.space.candidates,
        facts={},
        solutions={0: report_page_data.solution_of(setup.solver.solve(assembly.labels))},
        studio=_extra(session, root),
    )


def drawing_data(scene: Scene) -> page_contract.PageData:
    assembly = build_assembly(scene)
    return report_page_data.page_data(
        kind="studio", scene=scene, assembly=assembly, candidates=assembly.free_faces, facts={}
    )


def _extra(session: StudioSession, root: Path) -> dict[str, Any]:
    """Return data for the studio alone: folder, formats, changeable keys, vertices."""
    return {
        "folder": str(root),
        "formats": list(FORMATS),
        "changes": {key: session.document.get(key, {}) for key in CHANGEABLE},
        "joints": None if session.joints is None else session.joints.facts(),
    }
