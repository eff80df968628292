"""Meshes of Rhino to a running `jld studio`, and λ back: paste this file into a Python 3 script component of Rhino 8.

Start the studio first; it prints its address:

    jld studio --no-browser

Inputs of the component
    address   text: what the studio prints, http://127.0.0.1:PORT/TOKEN/
    blocks    list of meshes, closed: the free blocks
    supports  list of meshes, closed
    density   number, kg/m³, default 2000
    friction  number, friction coefficient of the joints, default 0.6
    load      list of three numbers: live load as a share of the weight, default [1, 0, 0]
    metres    number: length of a unit of the document in metres, default 1
Outputs
    load_factor  number, None without a collapse
    status       text: collapse, locked, unstable or uncertified, or what is wrong
    moved        list of lists of points: vertices of the blocks as the mechanism moves them
"""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from typing import Any

SECONDS = 20.0
SHARE = 0.05
"""Longest wait for an answer, and largest movement that is drawn, relative to the size of the structure."""


def solid(mesh: Any, name: str, support: bool, metres: float) -> dict[str, Any]:
    """Return a mesh of RhinoCommon or rhino3dm as an element of a scene, lengths in metres."""
    points = [[metres * p.X, metres * p.Y, metres * p.Z] for p in mesh.Vertices.ToPoint3dArray()]
    place: dict[tuple[float, ...], int] = {}
    number = [place.setdefault(tuple(point), len(place)) for point in points]
    count = mesh.Faces.Count if hasattr(mesh.Faces, "Count") else len(mesh.Faces)
    faces = []
    for k in range(count):
        face = mesh.Faces[k]
        loop = [face.A, face.B, face.C, face.D] if hasattr(face, "A") else list(face)
        ring = [number[index] for index in loop]
        ring = [index for position, index in enumerate(ring) if index != ring[position - 1]]
        if len(ring) > 2:
            faces.append(ring)
    found: dict[str, Any] = {"id": name, "vertices": [list(point) for point in place], "faces": faces}
    return {**found, "support": True} if support else found


def scene_of(
    blocks: list[Any], supports: list[Any], density: float, friction: float, load: list[float], metres: float = 1.0
) -> dict[str, Any]:
    """Return the scene of some meshes with dry joints between all of them."""
    elements = [solid(mesh, f"b{k}", False, metres) for k, mesh in enumerate(blocks)]
    elements += [solid(mesh, f"s{k}", True, metres) for k, mesh in enumerate(supports)]
    return {
        "name": "Rhino",
        "elements": elements,
        "materials": {"density": density, "dry": {"friction_coefficient": friction}},
        "loads": {"live": [{"body": list(load)}]},
    }


def ask(address: str, scene: dict[str, Any]) -> dict[str, Any]:
    """Return the answer of the studio to a scene; raise ValueError with its words where it refuses the scene."""
    url = address.rstrip("/") + "/api/evaluate"
    if not url.startswith("http://127.0.0.1:"):
        raise ValueError("address: it is none of a studio on this machine, as http://127.0.0.1:PORT/TOKEN/")
    body = json.dumps({"scene": scene}).encode()
    request = urllib.request.Request(url, body, {"Content-Type": "application/json"})
    try:
        with urllib.request.urlopen(request, timeout=SECONDS) as answer:
            found: dict[str, Any] = json.load(answer)
            return found
    except urllib.error.HTTPError as error:
        words = error.read().decode("utf-8", "replace")
        try:
            words = json.loads(words)["error"]
        except (ValueError, KeyError, TypeError):
            words = f"{error.code}: {words[:100]}"
        raise ValueError(words) from None
    except OSError as error:
        raise ValueError(f"no studio answers at the address ({error}): start jld studio") from None


def moved_points(scene: dict[str, Any], answer: dict[str, Any], metres: float = 1.0) -> list[list[list[float]]]:
    """Return the vertices of each free block as the mechanism moves them, in units of the document.

    The largest movement is a share `SHARE` of the size. The list is empty without a mechanism.
    """
    mechanism = answer.get("mechanism")
    if not mechanism:
        return []
    moves, largest = [], 0.0
    corners = [point for element in scene["elements"] for point in element["vertices"]]
    size = max(max(axis) - min(axis) for axis in zip(*corners, strict=True))
    for element in scene["elements"]:
        if element.get("support"):
            continue
        x, y, z, a, b, c = mechanism[element["id"]]
        middle = answer["centroids"][element["id"]]
        own = []
        for point in element["vertices"]:
            p, q, r = (one - other for one, other in zip(point, middle, strict=True))
            move = [x + b * r - c * q, y + c * p - a * r, z + a * q - b * p]
            largest = max(largest, sum(value * value for value in move) ** 0.5)
            own.append((point, move))
        moves.append(own)
    scale = SHARE * size / largest if largest else 0.0
    return [
        [[(p + scale * v) / metres for p, v in zip(point, move, strict=True)] for point, move in own] for own in moves
    ]


if "blocks" in globals() and "address" in globals():  # inside the component
    given = globals()
    measure = float(given.get("metres") or 1.0)
    try:
        sent = scene_of(
            given["blocks"],
            given.get("supports") or [],
            float(given.get("density") or 2000.0),
            float(given.get("friction") or 0.6),
            list(given.get("load") or [1.0, 0.0, 0.0]),
            measure,
        )
        told = ask(str(given["address"]), sent)
        load_factor, status, moved = told["load_factor"], told["status"], moved_points(sent, told, measure)
    except ValueError as problem:
        load_factor, status, moved = None, str(problem), []
