"""Exact search: refute labellings by conflicts until none can exceed the best one known.

docs/notes/exact.md has the idea and what always holds. The modules, in the order of the data:

1. `context`: data that stay fixed; when to aim at which λ, and when annealing seeks better labellings.
2. `driver`: `ProvingDriver` holds state, check and contradictions of every proof, by fields too (`field_exact`);
   `ConflictDriver` asks, checks and goes on; `Exact` proves the largest λ, or a front, and `minimum_count` the best
   count that carries a required λ. `Targets` hold what is to be proven.
3. `cube_workers` gets conflicts in this process, its threads or others; `conflict_generation` draws labellings from the
   `formula`, refutes them and minimises their conflicts.
4. `proof_state` stores conflicts and labellings handed over, once for all threads, and on record.
5. `block_tree` takes the place of conflicts of faces where blocks are small: a branch and bound with bounds from
   `block_bounds`. Its refuted nodes are conflicts as well. In any other long proof `block_bounds` bounds all labellings
   once.
6. `proof_check` derives the claims of the finished proof again, by another satisfiability solver and from the
   mechanisms alone; `certifying` writes the proof as a file.
"""

from __future__ import annotations

__all__: list[str] = []
