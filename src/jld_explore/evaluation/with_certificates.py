"""Asking the pool before solving, and feeding it with what was solved.

Labellings that a driver asks for together are settled in rounds: the pool settles what it can, then a few of
those it leaves open are solved, and what they prove is added in the order of the round. Which are solved, and
what the pool holds at any time, follows from the labellings asked alone, never from workers or clocks. What
every solve proved is kept in a file beside the store, so that a study that is gone on with has the same pool.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np

from jld_core.arrays import Bits, Bools, Floats, Ints
from jld_core.assembly import Assembly
from jld_core.limit import Status, crossed, load_floor
from jld_core.program import Template
from jld_explore.evaluation.certificates import FEW, ROUND, Bounds, Forces, Mechanism, Pool, Proofs, unknown
from jld_explore.evaluation.evaluation import CERTIFICATE, Evaluation
from jld_explore.evaluation.force_method import LARGEST

CERTIFICATES_FILE: Final = "certificates.jld"
_MANY: Final = 512
"""Labellings asked together that speak for those to come: fewer do not say what forces will be good for."""

_DIGITS: Final = 9
"""Digits of a scaled bound that tell one family of labellings from another."""

Solve = Callable[[Bits, Bits | None], list[Evaluation] | None]
"""Evaluate labellings (k, m), in company of those (j, m) that wait, where they are many; None where time ran out."""
Settle = Callable[[Bits, list[Evaluation]], list[Evaluation]]
"""Take in labellings (k, m) that certificates settled; what is on record of them wins."""


class CertificateEvaluator:
    """Evaluates labellings with a pool.

    pool: what is known. template: of the assembly. gap: width of a bracket that counts as solved. archive: where
    proofs are kept.
    """

    def __init__(self, pool: Pool, template: Template, gap: float, archive: Archive) -> None:
        self.pool, self.gap, self.archive = pool, gap, archive
        self.scale = template.scaling.load
        self.floor = load_floor(template.assembly) / self.scale
        self.small = is_small(template)
        self._round_size = FEW if self.small else ROUND
        self._asks = _asks(template.assembly)

    def evaluate(self, labellings: Bits, solve: Solve, settle: Settle) -> list[Evaluation] | None:
        """Evaluations of labellings (k, m) in their order; None where time ran out."""
        found: list[Evaluation | None] = [None] * len(labellings)
        many = len(labellings) >= _MANY
        bounds = self.pool.ask(labellings)
        # those that ask most of forces first: what carries them carries others as well
        left = np.lexsort((*labellings.T[::-1], -np.round(labellings @ self._asks, _DIGITS)))
        while left.size:
            known = self._settled(bounds.take(left))
            if known.any():
                evaluations = [self._evaluation(bounds, n) for n in left[known].tolist()]
                evaluations = settle(labellings[left[known]], evaluations)
                for n, evaluation in zip(left[known].tolist(), evaluations, strict=True):
                    found[n] = evaluation
                left = left[~known]
            chosen = self._round(bounds.high[left])
            if not chosen.size:
                break
            picked = left[chosen]
            solved = solve(labellings[picked], labellings[left] if many else None)
            if solved is None:
                return None
            now = self.pool.tick()
            for n, evaluation in zip(picked.tolist(), solved, strict=True):
                found[n] = evaluation
                self.pool.add(evaluation.proofs or Proofs())
            left = np.delete(left, chosen)
            news = self.pool.ask(labellings[left], now)
            fresh = unknown(len(labellings))
            fresh.low[left], fresh.high[left], fresh.unstable[left] = news.low, news.high, news.unstable
            bounds = bounds.tightened(fresh)
        return [evaluation for evaluation in found if evaluation is not None]

    def _settled(self, bounds: Bounds) -> Bools:
        known = np.isfinite(bounds.low) & np.isfinite(bounds.high)
        low, high = np.where(known, bounds.low, 0.0), np.where(known, bounds.high, 0.0)
        size = np.maximum(np.maximum(abs(low), abs(high)), self.floor)
        narrow = (high - low <= self.gap * size) & ~crossed(low, high)
        return np.asarray(bounds.unstable | (known & narrow))

    def _evaluation(self, bounds: Bounds, n: int) -> Evaluation:
        if bounds.unstable[n]:
            return Evaluation(Status.UNSTABLE, math.nan, math.nan, math.nan, settled=CERTIFICATE)
        low, high = float(bounds.low[n]) * self.scale, float(bounds.high[n]) * self.scale
        return Evaluation(Status.COLLAPSE, low, high, 0.5 * (low + high), settled=CERTIFICATE)

    def _round(self, high: Floats) -> Ints:
        """Positions of those to solve next: in order, one of each upper bound, any number without one."""
        # a mechanism bounds whole families of labellings by the same number, up to rounding
        value = np.where(np.isfinite(high), np.round(high, _DIGITS), np.inf)
        chosen: list[int] = []
        seen: set[float] = set()
        for position, bound in enumerate(value.tolist()):
            if bound in seen:
                continue
            if math.isfinite(bound):
                seen.add(bound)
            chosen.append(position)
            if len(chosen) == self._round_size:
                break
        return np.array(chosen, dtype=np.int64)


def is_small(template: Template) -> bool:
    """Is a labelling solved sooner than it is sent to a worker? Measured on planar walls, with the pool."""
    return not template.structure.cones and len(template.assembly.interfaces) <= LARGEST


def _asks(assembly: Assembly) -> Floats:
    """(m,) what a dry face asks of forces, from 1 to 2: the more, the less the dead load presses it."""
    dead = assembly.elements.weight.sum(axis=0)
    size = float(np.linalg.norm(dead))
    if size == 0.0:
        return np.ones(len(assembly.interfaces))
    return np.asarray(2.0 - abs(assembly.interfaces.normal @ dead) / size)


class Archive:
    """Proofs of solved labellings on disk; written by the parent process alone, before the store.

    A record: the packed labelling, how many forces and mechanisms, their numbers, a checksum. faces: m.
    """

    def __init__(self, folder: Path, faces: int) -> None:
        self.path, self.faces = folder / CERTIFICATES_FILE, faces
        self._bytes = (faces + 7) // 8
        self._known: dict[bytes, Proofs] = {}
        good = self._read() if self.path.exists() else 0
        self._file = open(self.path, "r+b" if self.path.exists() else "w+b", buffering=0)  # noqa: SIM115
        self._file.truncate(good)
        self._file.seek(good)

    def find(self, labels: Bits) -> Proofs | None:
        """What the solve of a labelling (m,) proved; None where it is not on record. Forgotten once found."""
        return self._known.pop(np.packbits(labels).tobytes(), None)

    def holds(self, labels: bytes) -> bool:
        """Whether what the solve of a packed labelling proved is on record."""
        return labels in self._known

    def append(self, labellings: Bits, proofs: list[Proofs]) -> None:
        """Write what solves of labellings (k, m) proved; it outlives this process at once."""
        self._file.write(b"".join(self._record(*pair) for pair in zip(labellings, proofs, strict=True)))

    def sync(self) -> None:
        """Wait until the disk has all that was appended."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Wait until the disk has all that was appended, and close the file."""
        if not self._file.closed:
            self.sync()
        self._file.close()

    def _record(self, labels: Bits, proofs: Proofs) -> bytes:
        parts = [np.packbits(labels).tobytes(), struct.pack("<BB", len(proofs.forces), len(proofs.mechanisms))]
        for forces in proofs.forces:
            parts.append(struct.pack("<d", forces.load))
            parts += [np.packbits(forces.dry).tobytes(), np.packbits(forces.inner).tobytes()]
        for mechanism in proofs.mechanisms:
            parts.append(struct.pack("<dB", mechanism.constant, mechanism.falls))
            parts += [mechanism.dry.astype("<f8").tobytes(), mechanism.inner.astype("<f8").tobytes()]
        body = b"".join(parts)
        return body + struct.pack("<I", zlib.crc32(body))

    def _read(self) -> int:
        """Take in an existing file up to its first torn record; returns how many bytes are good."""
        content, bits, good = self.path.read_bytes(), self._bytes, 0
        while good + bits + 2 <= len(content):
            counts = struct.unpack_from("<BB", content, good + bits)
            end = good + bits + 2 + counts[0] * (8 + 2 * bits) + counts[1] * (9 + 16 * self.faces)
            if end + 4 > len(content):
                break
            body = content[good:end]
            if zlib.crc32(body) != struct.unpack_from("<I", content, end)[0]:
                break
            self._known[body[:bits]] = self._proofs(body[bits + 2 :], *counts)
            good = end + 4
        return good

    def _proofs(self, body: bytes, forces: int, mechanisms: int) -> Proofs:
        m, bits, place = self.faces, self._bytes, 0
        found, moves = [], []
        for _ in range(forces):
            masks = np.frombuffer(body, np.uint8, 2 * bits, place + 8).reshape(2, bits)
            dry, inner = np.unpackbits(masks, axis=1, count=m).astype(bool)
            found.append(Forces(struct.unpack_from("<d", body, place)[0], dry, inner))
            place += 8 + 2 * bits
        for _ in range(mechanisms):
            constant, falls = struct.unpack_from("<dB", body, place)
            dry, inner = np.frombuffer(body, "<f8", 2 * m, place + 9).reshape(2, m)
            moves.append(Mechanism(constant, dry, inner, bool(falls)))
            place += 9 + 16 * m
        return Proofs(tuple(found), tuple(moves))
