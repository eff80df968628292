"""Relaxation of undecided faces that may crush: a dry and an inner copy share the forces.

With a bound on N, the rows of the closed hull of the dry and the inner set are not known in closed form. The hull is
the set of forces that two copies of the face carry together. One copy has (1 − w) times the dry set, the other has w
times the inner set, 0 ≤ w ≤ 1:

    F = F₁ + F₂,   G_dry F₁ ≤ (1 − w) h_dry,   G_inner F₂ ≤ w h_inner

(docs/method.md (6.3)). Both copies of a decided face have its own label, so together they carry what the face carries.
One structure therefore serves all partial labellings.
"""

from __future__ import annotations

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.program import ConicProgram, Structure, Template


class SharedHull:
    """Programs of partial labellings of one template whose joints may crush.

    template: scaled programs of one assembly. Raises ValueError if yield rows have extra columns.
    """

    def __init__(self, template: Template) -> None:
        sets, pattern, matrix = template.yield_set, template.yield_set.pattern, template.matrix.tocoo()
        if pattern.extra:
            raise ValueError("the perspective of rows with extra columns is not defined")
        faces, (equalities, resultants) = len(template.assembly.interfaces), template.matrix.shape
        q = template.assembly.freedoms
        every = np.ones(faces, dtype=bool)
        on_dry, on_inner = sets.active(every).ravel(), sets.active(~every).ravel()
        row, column = (np.asarray(part, dtype=np.int64) for part in matrix.coords)
        share = 2 * resultants  # The columns of w follow those of both copies; λ is last.
        last = share + faces
        # Linear rows are λ ≥ −floor, 0 ≤ w, w ≤ 1, then those of both copies; cones are last.
        first = equalities + 1 + 2 * faces
        count = len(pattern.h_dry)
        places = [self._places(pattern.linear, count, copy) + first for copy in (0, 1)]
        entries: list[tuple[Ints, Ints, Ints, Floats, Floats]] = []
        for copy in (0, 1):
            owner = column // q + faces * copy
            own = resultants * copy
            dry, inner = (np.asarray(matrix.data * on[column], dtype=float) for on in (on_dry, on_inner))
            entries.append((row, column + own, owner, dry, inner))
            face = pattern.face + faces * copy
            entries.append((places[copy][pattern.row], pattern.column + own, face, pattern.dry, pattern.inner))
            sign = -1.0 if copy else 1.0
            owner, at = pattern.row_face + faces * copy, share + pattern.row_face
            entries.append((places[copy], at, owner, sign * pattern.h_dry, sign * pattern.h_inner))
        live = np.flatnonzero(template.live)
        none = np.zeros(live.size, dtype=np.int64)
        entries.append((live, none + last, none, template.live[live], template.live[live]))
        every_face, one = np.arange(faces), np.ones(faces)
        entries.append((np.array([equalities]), np.array([last]), np.array([0]), -np.ones(1), -np.ones(1)))
        entries.append((equalities + 1 + every_face, share + every_face, every_face, -one, -one))
        entries.append((equalities + 1 + faces + every_face, share + every_face, every_face, one, one))
        rows, columns, owners, dry, inner = (np.concatenate(parts) for parts in zip(*entries, strict=True))
        order = np.lexsort((rows, columns))
        self._owner, self._dry, self._inner = owners[order], dry[order], inner[order]
        indptr = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=last + 1))])
        self.structure = Structure(
            indices=rows[order],
            indptr=indptr,
            shape=(first + 2 * count, last + 1),
            equalities=equalities,
            linear=1 + 2 * faces + 2 * pattern.linear,
            cones=(*pattern.cones, *pattern.cones),
        )
        head = np.concatenate([-template.dead, [template.floor], np.zeros(faces), np.ones(faces)])
        self._rhs = np.zeros((2, first + 2 * count))  # Row 0 holds the dry values, row 1 the inner values.
        self._rhs[:, :first] = head
        self._rhs[0, places[0]], self._rhs[1, places[0]] = pattern.h_dry, pattern.h_inner
        self._first, self._row_face = places[0], pattern.row_face
        self._objective = np.zeros(last + 1)
        self._objective[-1] = -1.0
        self._pressure = np.zeros(last + 1)
        self._pressure[0 : 2 * resultants : q] = -1.0

    @staticmethod
    def _places(linear: int, count: int, copy: int) -> Ints:
        """Return the row indices (count,) of one of two copies of yield rows.

        Linear rows of both copies come first, then cones of both. Indices count from the first row of both. linear:
        number of linear rows of a copy. count: number of all its rows. copy: 0 or 1.
        """
        rows = np.arange(count)
        return np.where(rows < linear, rows + linear * copy, rows + linear + (count - linear) * copy)

    def program(self, labels: Bits, undecided: Bools, margin: float) -> ConicProgram:
        """Return the program of a partial labelling.

        labels: (m,) labels, True = dry; ignored where undecided. undecided: (m,) faces that may have either label.
        margin: reward of every normal force in the objective, scaled, so that the jumps found are opening. Result: the
        program, scaled. Columns: the resultants of the first, then of the second copy of each face; the share of its
        second copy; λ as the last one.
        """
        copies = np.concatenate([labels | undecided, labels & ~undecided])
        data = np.where(copies[self._owner], self._dry, self._inner)
        rhs = self._rhs[0].copy()
        rhs[self._first] = np.where(copies[self._row_face], self._rhs[0, self._first], self._rhs[1, self._first])
        return ConicProgram(self.structure, data, rhs, self._objective + margin * self._pressure)
