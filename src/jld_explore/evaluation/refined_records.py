"""Store bounds from finer meshes beside the record of a study, under its lock.

The record itself keeps the evaluations on the coarsest mesh, because a resumed driver must see the same evaluations as
before. Tables of results show the narrower bounds.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from typing import Final

import numpy as np

from jld_core.arrays import Bits
from jld_core.files import whole_file
from jld_explore.evaluation.evaluation import Evaluation
from jld_explore.evaluation.record_file import damaged
from jld_explore.evaluation.records import Records
from jld_explore.evaluation.rows import Rows, checksums, keys_of, rows_of

REFINED_FILE: Final = "refined.npz"
"""Name of the file of refined evaluations in the folder of a study."""


class RefinedRecords:
    """Rows of a record in which refined evaluations replace those of the coarsest mesh.

    records: record of the study, open or closed. faces: number m of faces. Raises InputError if the file of refined
    evaluations is damaged.
    """

    def __init__(self, records: Records) -> None:
        self.faces, self._records = records.faces, records
        self._path = records.folder / REFINED_FILE
        self._refined = np.empty(0, dtype=records.type)
        if self._path.exists():
            self._refined = self._read()

    def _read(self) -> Rows:
        """Read the refined rows; raise InputError if they are not as they were written."""
        try:
            with np.load(io.BytesIO(self._path.read_bytes()), allow_pickle=False) as content:
                rows, made = np.asarray(content["rows"]), content["checksum"].tolist()
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise damaged(self._path, str(error)) from None
        if rows.dtype != self._records.type or checksums(rows) != made:
            raise damaged(self._path, "its rows are not as they were written")
        return rows

    @property
    def rows(self) -> Rows:
        """Return all rows in the order of the record, with refined evaluations where known."""
        rows = self._records.rows.copy()
        place = {key: n for n, key in enumerate(keys_of(rows))}
        for own, key in zip(self._refined, keys_of(self._refined), strict=True):
            if key in place:
                rows[place[key]] = own
        return rows

    def keep(self, labellings: Bits, multiplicities: Sequence[int], evaluations: Sequence[Evaluation]) -> None:
        """Write refined evaluations in one step; they replace all that were kept before.

        labellings: (k, m) True = dry. multiplicities: orbit sizes under the symmetries.
        """
        rows = rows_of(self._records.type, labellings, multiplicities, evaluations)
        with whole_file(self._path) as fresh, fresh.open("wb") as file:
            np.savez_compressed(file, rows=rows, checksum=np.array(checksums(rows), dtype=np.int64))
        self._refined = rows
