"""Vertices of joints that a user drags on the page, and steps of `jld move`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from jld_core import Assembly, Bits, Floats, InputError, Scene
from jld_core.limit import number
from jld_core.scene import move as scene_move
from jld_geometry import MovedScene, TrustRegion, move_joints, vertex_mesh
from jld_geometry.convex_cells import VertexMesh
from jld_geometry.variables import SAME, Variables, mirrored, variables_of, vertex_at

SECONDS: Final = 3.0
"""Time limit of one improvement, s; a page waits for it."""

STEPS: Final = 6
"""Number of steps of an improvement that are tried."""


class JointVertices:
    """Vertices, as in `vertex_mesh`, of one planar scene's faces that the page may move.

    Ends of a face that belong to no support move inside freely, and along an outline or circle that the key "move"
    names.
    """

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
        found, paths = self._variables, dict[str, Any]()
        for vertex in sorted(self._movable):
            own = np.flatnonzero(found.vertex == vertex)
            if not np.isnan(found.centre[own[0], 0]):
                paths[str(vertex)] = {"circle": found.centre[own[0]].tolist()}
            else:
                paths[str(vertex)] = {} if len(own) > 1 else {"direction": found.direction[own[0]].tolist()}
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
        found: dict[int, list[tuple[int, int]]] = {}
        if ties == "mirror-x":
            partner = mirrored(self._variables, self._assembly)
            return {k: [(int(partner[k]), -1)] for k in self._movable if partner[k] != k}
        for group in ties if isinstance(ties, list) else []:
            own = [vertex_at(self.mesh.places, point, self._assembly.size, "move.ties") for point in group]
            for vertex in own:
                found.setdefault(vertex, []).extend((other, 1) for other in own if other != vertex)
        return found

    def placed(self, vertices: object) -> Floats:
        """Return the places (v, 2) of all vertices, with those of a request; InputError if one may not move."""
        if not isinstance(vertices, dict):
            raise InputError("vertices", "they are no JSON object", "an object from vertex to [x, y]")
        found = self.mesh.places.copy()
        for name, place in vertices.items():
            if not name.isdecimal() or int(name) not in self._movable:
                raise InputError("vertices", f"{name[:40]!r} is no vertex that may move", "a vertex of a joint")
            right = isinstance(place, list) and len(place) == 2
            if not right or not all(type(one) in (int, float) and math.isfinite(one) for one in place):
                raise InputError(f"vertices.{name}", f"it is {str(place)[:40]}", "two finite numbers [x, y]")
            found[int(name)] = place
        return found

    def scene(self, base: Scene, labels: Bits, places: Floats) -> Scene:
        """Return a scene with its vertices at the places (v, 2)."""
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
        shown = scene.model_copy(update={"move": move})
        done = move_joints(shown, assembly, labels, seconds=SECONDS, trust=TrustRegion(points=STEPS))
        # the mesh of what is shown may number its vertices in another way
        start = done.places - done.moved
        distance, same = cKDTree(start).query(places)
        known = np.asarray(distance) <= SAME * assembly.size
        ends = places + np.where(known[:, None], done.moved[same], 0.0)
        changed = np.flatnonzero(abs(ends - self.mesh.places).max(axis=1) > 0.0).tolist()
        return {
            "vertices": {str(vertex): ends[vertex].tolist() for vertex in changed if vertex in self._movable},
            "start": number(done.start),
            "value": number(done.value),
            "steps": len(done.points) - 1,
            "end": done.end,
        }
