"""What the record of a study costs: rows written and read again, by how many are written together, and their bytes.

The three formats of fixed records that stood here before (evaluations, certificates, conflicts; each with its own
checksums, torn tails and waits for the disk) were measured with the same rows on the same machine at commit ca40816.
Repeated beside it, on a machine with more to do than cores, they wrote 69, 293 and 524 thousand rows a second.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common import about, table, write
from jld_core.arrays import Bits
from jld_core.limit import Status
from jld_explore.evaluation import Evaluation, Records
from jld_explore.evaluation.certificates import Forces, Mechanism, Proofs
from jld_explore.evaluation.records import RECORDS_FILE

FACES: Final = 64
ROWS: Final = ((1, 20_000), (8, 100_000), (64, 200_000), (16_384, 1_000_000))
"""Rows written together, and in all."""

BEFORE: Final = {1: (80, 0.01, 58.0), 8: (341, 0.08, 58.0), 64: (543, 0.18, 58.0), 16_384: (594, 0.90, 58.0)}
"""Thousand rows a second of processor time, seconds to open the file, bytes a row: of the formats before."""


def measured(together: int, count: int, proofs: Proofs | None = None) -> tuple[float, float, float]:
    """Thousand rows a second of processor time, processor seconds to open the file again, bytes a row."""
    rng = np.random.default_rng(0)
    rows: Bits = rng.random((count, FACES)) < 0.5
    found = [Evaluation(Status.COLLAPSE, v, v, v, proofs=proofs) for v in rng.random(count).tolist()]
    with tempfile.TemporaryDirectory() as folder:
        records = Records(Path(folder), {}, FACES)
        start = time.process_time()
        for low in range(0, count, together):
            part = slice(low, min(low + together, count))
            records.append(rows[part], [1] * (part.stop - low), found[part])
        records.close()
        written = time.process_time() - start
        size = (Path(folder) / RECORDS_FILE).stat().st_size
        start = time.process_time()
        records = Records(Path(folder), {}, FACES)
        read = time.process_time() - start
        records.close()
    return count / written / 1e3, read, size / count


def main() -> None:
    """Measure every size of batch, and rows that carry proofs."""
    head = ["together", "rows", "1000 rows/s", "before", "open [s]", "before", "bytes/row", "before"]
    rows = []
    for together, count in ROWS:
        now, then = measured(together, count), BEFORE[together]
        pairs = [
            f"{value:.{digits}f}" for one, two, digits in zip(now, then, (0, 2, 0), strict=True) for value in (one, two)
        ]
        rows.append([str(together), str(count), *pairs])
    mask = np.arange(FACES) % 3 == 0
    proofs = Proofs((Forces(1.0, mask, ~mask),), (Mechanism(1.0, mask * 1.0, mask * 2.0, False),))
    speed, read, size = measured(64, 20_000, proofs)
    text = [
        "# What the record of a study costs",
        "",
        about(__doc__),
        "",
        table(head, rows),
        "",
        f"With the forces and the mechanism of each solve, 64 together: {speed:.0f} 000 rows/s, {size:.0f} bytes each;",
        f"opened in {read:.2f} s (20 000 rows, whose proofs are read when they are asked for).",
    ]
    write("records", "\n".join(text))


if __name__ == "__main__":
    main()
