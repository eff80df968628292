"""Provide the text of `jld --help` without slow imports, so that it appears at once."""

from __future__ import annotations

from typing import Final

from jld_core import plugins

# description of each command, in the order of use
COMMANDS: Final = {
    "new": "write a scene by name: arch, wall, corner, vault, dome, flat-arch, buttress, grid",
    "import": "make a scene of a drawing or of solids",
    "design": "the blocks of an outline: cells tried, joints searched and moved, the best checked",
    "refine": "split the elements of a scene into smaller candidate cells",
    "check": "what will be modelled, and what looks wrong",
    "solve": "collapse load factor of one layout, with a two-sided bracket",
    "explore": "search the layouts of a scene for the strongest: table, front, pictures, page",
    "move": "move the joints of a layout for the largest load factor, or prove the best in a box",
    "verify": "check the certificate of a proof",
    "plot": "draw a scene, or a search again",
    "studio": "move joints by hand and see the proven load follow, in a browser",
    "experiment": "load a layout in a virtual experiment until it comes down",
    "assembly": "an order in which the blocks can be laid",
    "check-design": "partial factors: utilisation, reactions, joints near their limit, and a page to file",
    "report": "printed pages of a layout: loads, numbered stones, moulds, laying, what is proven",
    "reliability": "reliability index of a layout whose strengths and loads have distributions",
    "settlement": "the thrust that is left where supports give way",
    "thrust": "least and greatest reaction of supports, and forces across joints",
    "export": "write the blocks of a layout for another program",
}

# description of each search driver
DRIVERS: Final = {
    "enumeration": "every layout once; the best is proven. Default where the space is small",
    "exact": "proves the best of spaces far too large to enumerate. Default where that is in reach",
    "genetic": "good layouts of large scenes, and fronts. Default elsewhere",
    "random": "a baseline",
    "hillclimb": "a baseline",
    "anneal": "the strongest layout of a large scene, without proof",
    "optuna": "any of its samplers",
}

_HEAD = """Usage: jld [OPTIONS] COMMAND [ARGS]...

  Joint Layout Design: find the strongest way to cut a structure into
  dry-jointed blocks, with proof.
"""
_OPTIONS = {"--version": "Print the version and stop.", "--help": "Show this message, or that of a COMMAND, and stop."}
_EXAMPLE = """  jld new wall --length 1.2 --courses 6 -o wall.json
  jld check wall.json
  jld explore wall.json --out out/wall --seconds 60
  jld export out/wall --format dxf -o wall.dxf"""


def _added(group: str) -> dict[str, str]:
    """Return what installed plug-ins add to a group, with the package of each."""
    return {name: f"of the package {plugins.package(one)}" for name, one in plugins.entry_points(group).items()}


def text() -> str:
    """Return the text of `jld --help`: commands, drivers and an example."""
    parts = [_HEAD]
    tables = {
        "Options": _OPTIONS,
        "Commands": _added("jld.commands") | COMMANDS,
        "Drivers of jld explore (--driver)": DRIVERS | _added("jld.drivers"),
        "Objectives of plug-ins (--objective)": _added("jld.objectives"),
        "Counts of plug-ins (search.front, search.limits)": _added("jld.counts"),
        "Criteria of plug-ins (materials.inner.criterion, materials.dry.criterion)": _added("jld.criteria"),
        "Steps of plug-ins (after jld explore)": _added("jld.steps"),
    }
    for title, lines in tables.items():
        if not lines:
            continue
        width = max(map(len, lines))
        parts.append("\n".join([f"{title}:", *(f"  {name:<{width}}  {words}" for name, words in lines.items())]) + "\n")
    return "\n".join([*parts, "Example:", _EXAMPLE, ""])
