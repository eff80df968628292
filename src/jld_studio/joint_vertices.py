"""Vertices of joints that a user drags on the page, and steps of `jld move`."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from scipy.spatial import cKDTree

from jld_core import Assembly, Bits, Floats, InputError
from jld_core.limit import number
from jld_core.scene import Scene
from jld_core.scene import move as scene_move
from jld_geometry.convex_cells import VertexMesh, vertex_mesh
from jld_geometry.moved_scene import MovedScene
from jld_geometry.optimise import move_joints
from jld_geometry.search import TrustRegion
from jld_geometry.variables import SAME, Variables, mirrored, variables_of, vertex_at

SECONDS: Final = 3.0
"""Time limit of one improvement, s; a page waits for it."""

STEPS: Final = 6
"""Number of steps of an improvement that are tried."""


class JointVertices:
    """Vertices of the faces of one planar scene that the page of the studio may move.

    Vertices are numbered as in `vertex_mesh`. Those that are ends of a face and belong to no support may move: inside
    the structure freely, on a straight outline or a circle that the key "move" names along it.

    scene: planar scene of the studio. Raises InputError: no vertex can move, or the key "move" does not fit the
    structure.
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
        """Return the data by which a page drags vertices, as JSON.

        Result: `places` of all vertices, lengths; `loops`, the vertices around each element; `ends`, two vertices of
        each face; `paths`, by vertex, how it moves: {} freely, {"direction": vector} or {"circle": centre}; `ties`, by
        vertex, the others that move with it, as pairs of a vertex and a factor on the displacement in x.
        """
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
        """Return the vertices that move with each vertex by the key "ties".

        Each comes with its factor on the displacement in x: 1, or −1 for mirrored vertices.
        """
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
        """Return the places (v, 2) of all vertices, with those of a request.

        Raises InputError for anything else, or a vertex that may not move.
        """
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
        """Return a scene with its vertices at the places (v, 2).

        Raises InputError where the places make no valid scene.
        """
        return self.mover(base, labels).at(places)

    def mover(self, base: Scene, labels: Bits) -> MovedScene:
        """Return the factory of the scene with its vertices at given places.

        Arguments as in `scene`.
        """
        return MovedScene(base, self._assembly, labels, self.mesh)

    def improved(self, scene: Scene, assembly: Assembly, labels: Bits, places: Floats) -> dict[str, Any]:
        """Move joints by some steps of `jld move` from the state that a page shows.

        labels: (m,) labels shown, True = dry. places: (v, 2) places of the vertices that the page shows. Result:
        `vertices`, from vertex to place [x, y], of those that are not where the studio's scene has them; `start` and
        `value`, λ before and after (None: it does not stand, or is locked); `steps`; `end`, as `MovedJoints.end`.
        Raises InputError: nothing can move, or nothing that was tried stands.
        """
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
