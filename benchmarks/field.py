"""compas_cra on the same walls and arch, in the same run: its times and ours, and what each answers.

compas_cra (Kao et al. 2022, doi 10.1016/j.cad.2022.103216) asks whether an assembly stands under its own weight:
RBE looks for forces that balance with as little tension as may be, CRA for forces that also go with a virtual motion
of the blocks. Neither knows a load factor. Both get the blocks that we get; contacts are found by each program itself.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks.common import RESULTS, about, table, write
from benchmarks.scenes import box, brick_boxes
from jld_core import build_assembly, parse_scene, solve
from jld_core.views.figures import save_figure

FRICTION: Final = 0.65
UNIT: Final = (1.0, 0.5, 0.5)
"""Bricks of the size that compas_cra's absolute tolerances are made for."""
MISSING: Final = "compas_cra is not installed, so there is nothing to compare with: pip install 'jld[field]'"


@dataclass(frozen=True)
class Row:
    """What one program did: interfaces found, processor time for contacts and for the solve, and its answer."""

    method: str
    interfaces: int
    contacts: float
    solve: float
    answer: str


def wall(courses: int, bricks: int) -> list[dict[str, Any]]:
    """Elements of a wall of one wythe in running bond on a slab."""
    return [
        box(name, low, high, **({"support": True} if name == "slab" else {}))
        for name, low, high in brick_boxes(courses, bricks, 1, UNIT)
    ]


def arch(blocks: int = 20, inner: float = 5.0, thickness: float = 0.75, depth: float = 0.5) -> list[dict[str, Any]]:
    """Elements of a semicircular arch of equal voussoirs, the first and the last of them supports."""
    angles = np.linspace(0.0, np.pi, blocks + 1)
    elements = []
    for k, (first, last) in enumerate(itertools.pairwise(angles)):
        corners = [
            [radius * float(np.cos(angle)), y, radius * float(np.sin(angle))]
            for angle in (first, last)
            for y in (0.0, depth)
            for radius in (inner, inner + thickness)
        ]
        faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
        elements.append({"id": f"v{k}", "vertices": corners, "faces": faces, "support": k in (0, blocks - 1)})
    return elements


def ours(elements: list[dict[str, Any]], along: list[float]) -> Row:
    """λ of a horizontal body load with both bounds, and whether it stands without."""
    document = {
        "elements": elements,
        "materials": {"density": 1.0, "gravity": 1.0, "dry": {"friction_coefficient": FRICTION}},
        "loads": {"live": [{"body": along}]},
    }
    start = time.process_time()
    assembly = build_assembly(parse_scene(document))
    middle = time.process_time()
    found = solve(assembly)
    end = time.process_time()
    low, high = found.bracket
    stands = {True: "stands, proven", False: "does not stand, proven", None: "not known"}[found.stands_at_zero]
    answer = f"{stands}; λ in [{low:.9f}, {high:.9f}]"
    return Row("jld", len(assembly.interfaces), middle - start, end - middle, answer)


def theirs(elements: list[dict[str, Any]], method: str) -> Row:
    """One of compas_cra's solvers by name, "rbe" or "cra"."""
    from compas_assembly.datastructures import Block
    from compas_cra import equilibrium
    from compas_cra.algorithms import assembly_interfaces_numpy
    from compas_cra.datastructures import CRA_Assembly

    solver: Callable[..., Any] = {"rbe": equilibrium.rbe_solve, "cra": equilibrium.cra_solve}[method]
    assembly = CRA_Assembly()
    for element in elements:
        assembly.add_block(Block.from_vertices_and_faces(element["vertices"], element["faces"]))
    assembly.set_boundary_conditions([k for k, element in enumerate(elements) if element.get("support")])
    with contextlib.redirect_stdout(io.StringIO()):  # it prints its matrices' shapes and every density
        start = time.process_time()
        assembly_interfaces_numpy(assembly, nmax=len(elements), amin=1e-4)
        middle = time.process_time()
        try:
            solver(assembly, mu=FRICTION)
            failure = ""
        except ValueError as error:
            failure = str(error)
        end = time.process_time()
    found = [face for edge in assembly.graph.edges() for face in assembly.graph.edge_attribute(edge, "interfaces")]
    return Row(f"compas_cra {method.upper()}", len(found), middle - start, end - middle, failure or _answer(found))


def _answer(interfaces: list[Any]) -> str:
    """Stands, if no corner pulls by more than its solver's tolerance."""
    corners = [corner for face in interfaces for corner in face.forces]
    pull, push = max(c["c_nn"] for c in corners), max(c["c_np"] for c in corners)
    return f"{'stands' if pull < 1e-5 * push else 'does not stand'} (largest tension / compression {pull / push:.0e})"


def cases(large: bool = True) -> dict[str, tuple[list[dict[str, Any]], list[float]]]:
    """Elements and direction of the live load by name; large: the three of the record, else one for a test."""
    if not large:
        return {"wall 2 × 2": (wall(2, 2), [0.0, 1.0, 0.0])}
    return {
        "wall 5 × 5": (wall(5, 5), [0.0, 1.0, 0.0]),
        "wall 10 × 10": (wall(10, 10), [0.0, 1.0, 0.0]),
        "arch of 20": (arch(), [1.0, 0.0, 0.0]),
    }


def measure(elements: list[dict[str, Any]], along: list[float]) -> list[Row]:
    """Ours and both of theirs on one case."""
    return [ours(elements, along), *(theirs(elements, method) for method in ("rbe", "cra"))]


def rows_of(name: str, elements: list[dict[str, Any]], found: list[Row]) -> list[list[str]]:
    """Table rows of one case."""
    mine = found[0].contacts + found[0].solve
    free = sum(not element.get("support") for element in elements)
    return [
        [
            name,
            str(free),
            row.method,
            str(row.interfaces),
            f"{row.contacts:.3f}",
            f"{row.solve:.3f}",
            f"{(row.contacts + row.solve) / mine:.1f}",
            row.answer,
        ]
        for row in found
    ]


def draw(results: dict[str, list[Row]]) -> Figure:
    """Times by case and program, contacts and solve apart, on a logarithmic axis."""
    figure = Figure(figsize=(4.2 * len(results), 3.4), dpi=110, layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(results), sharey=True))
    for ax, (name, rows) in zip(panels, results.items(), strict=True):
        place = np.arange(len(rows))
        for part, colour, shift in (("contacts", "#92c5de", -0.2), ("solve", "#2166ac", 0.2)):
            bars = ax.bar(place + shift, [getattr(row, part) for row in rows], 0.38, color=colour, label=part)
            ax.bar_label(bars, fmt="%.3g", fontsize=8)
        ax.set_xticks(place, [row.method.replace("compas_cra ", "compas_cra\n") for row in rows], fontsize=9)
        ax.set_yscale("log")
        ax.set_title(name, fontsize=11)
    panels[0].set_ylabel("processor time, s")
    panels[0].set_ylim(top=3.0 * panels[0].get_ylim()[1])
    panels[0].legend(frameon=False, fontsize=9)
    return figure


def main() -> None:
    """Compare on all cases and write benchmarks/results/field.md, or say what is missing."""
    if find_spec("compas_cra") is None:
        print(MISSING)
        return
    for case in cases(large=False).values():
        measure(*case)  # loads what is loaded once
    results = {name: measure(*case) for name, case in cases().items()}
    rows = [row for name, found in results.items() for row in rows_of(name, cases()[name][0], found)]
    save_figure(draw(results), RESULTS / "field.png")
    head = ["scene", "free blocks", "program", "interfaces", "contacts, s", "solve, s", "total / jld", "answer"]
    text = about(__doc__)
    note = (
        f"Bricks of 1 × 0.5 × 0.5, one wythe, all dry, friction {FRICTION}; the arch of radius 5 and thickness 0.75 "
        "has its first and last voussoir held. Live load of jld: horizontal body load, out of plane for the walls, in "
        "plane for the arch. Processor times. Contacts: finding interfaces from the blocks; compas_cra is told to try "
        "all pairs, as the slab's centroid is near to few bricks. Point contacts at the corners and a friction pyramid "
        "of eight sides there; resultants at the centre of pressure and a friction cone here. The penalty form of CRA "
        "is left out: it took 202 s on the 10 × 10 wall."
    )
    parts = ["# Against the field", text, "![Times by scene and program](field.png)", table(head, rows), note]
    write("field", "\n\n".join(parts), also=("compas_cra", "compas"))


if __name__ == "__main__":
    main()
