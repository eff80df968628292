"""Check proofs of the exact driver by code that is independent of the search.

- `Balances`: exact work balances of mechanisms of one assembly under one load
- `Checker`: checker of the reasons of one claim, in order
- `Claim`: statement that a certificate proves
- `Labellings`: labellings of a scene as clauses
- `Lemma`: reason: a clause that follows from earlier ones
- `Mechanism`: reason: a mechanism that refutes labellings
- `Reason`: type of one line of a certificate
- `Rule`: reason: a rule of the scene that excludes labellings
- `Verified`: result of checking a certificate
- `verify`: check a certificate
- `write`: write a certificate
"""

from __future__ import annotations

from jld_explore.verification.balance import Balances
from jld_explore.verification.certificate import Claim, Lemma, Mechanism, Reason, Rule, write
from jld_explore.verification.labellings import Labellings
from jld_explore.verification.verify import Checker, Verified, verify

__all__ = [
    "Balances",
    "Checker",
    "Claim",
    "Labellings",
    "Lemma",
    "Mechanism",
    "Reason",
    "Rule",
    "Verified",
    "verify",
    "write",
]
