"""A proof of the exact driver, checked by code that shares nothing with what found it.

- `Balances`: what a mechanism proves about λ, in whole numbers
- `Checker`: the reasons of one claim, in order
- `Claim`: what a certificate says
- `Labellings`: what a scene lets be labelled
- `Lemma`: a clause that follows from others
- `Mechanism`: a reason why labellings are too weak
- `Reason`: one line of a certificate
- `Rule`: a reason why labellings are none of the scene
- `Verified`: what has been checked
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
