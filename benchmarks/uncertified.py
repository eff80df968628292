"""How rare `uncertified` is on random scenes: one random labelling of each, planar, spatial, and without dilation.

The scenes are those of benchmarks/trust_scenes.py: supports, holes, materials with every strength or nearly none, load
cases; labellings are drawn face by face, so many of them stand by a hair. At 0.1.0 random scenes of another maker gave
0.3 % planar, 3.6 % spatial, and 10 % without dilation.
`python -m benchmarks.uncertified SCENES` takes so many of each kind.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from typing import Final

import numpy as np

from benchmarks.common import about, table, write
from benchmarks.trust_scenes import draw
from jld_core import Assembly, InputError, build_assembly, parse_scene, solve
from jld_core.arrays import Bits
from jld_core.limit import Friction

SCENES: Final = 300

KINDS: Final = ("planar", "spatial", "planar, without dilation")


def scenes(dimension: int) -> Iterator[tuple[Assembly, Bits]]:
    """Assemblies of a dimension with a random labelling each, seed by seed, without end."""
    seed = -1
    while True:
        seed += 1
        rng = np.random.default_rng([seed, 11])
        try:
            assembly = build_assembly(parse_scene(draw(rng)[0]))
        except InputError:  # its numbers draw no scene
            continue
        if assembly.dimension == dimension:
            yield assembly, rng.random(len(assembly.interfaces)) < rng.random()


def tally(kind: str, count: int) -> Counter[str]:
    """Statuses of `count` labellings."""
    found: Counter[str] = Counter()
    friction: Friction = "zero-dilation" if "dilation" in kind else "associative"
    for assembly, labels in scenes(3 if kind == "spatial" else 2):
        try:
            found[str(solve(assembly, labels, friction=friction).status)] += 1
        except InputError:  # a material that this labelling needs is not stated
            continue
        if found.total() == count:
            break
    return found


def main(count: int = SCENES) -> None:
    """Measure, and write one row a kind."""
    rows = []
    for kind in KINDS:
        found = tally(kind, count if kind != KINDS[2] else count // 3)
        share = found["uncertified"] / found.total()
        names = ("collapse", "unstable", "locked", "uncertified")
        rows.append([kind, *(str(found[name]) for name in names), f"{share:.1%}"])
        print(rows[-1], flush=True)
    head = ["", "collapse", "unstable", "locked", "uncertified", "share"]
    write("uncertified", "\n\n".join(["# How rare uncertified is", about(__doc__), table(head, rows)]))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else SCENES)
