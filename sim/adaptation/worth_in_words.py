"""The worth of a checkpoint, from its card, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

NOTABLE = 0.25
"""Shares below this are not worth a sentence."""

BLURRED = 0.1
"""A larger error of the expected reward is a warning."""


def worth_in_words(worth: Mapping[str, Any] | None) -> list[str]:
    """Sentences about a card's table `worth`, warnings among them; none for a card without it."""
    if not worth:
        return []
    error, sentences = worth.get("reward_error"), list[str]()
    if error is not None:
        warning = ": simulate more, or choose a smoother reward" if error > BLURRED else ""
        sentences.append(f"The emulator errs by {error:.2f} of the reward on rollouts that it has not seen{warning}.")
    if (share := worth.get("hopeless_parameters", 0.0)) > 0.0:
        sentences.append(f"In {share:.0%} of the parameters' ranges no action is expected to earn half of the reward.")
    if (share := worth.get("hopeless_contexts", 0.0)) > NOTABLE:
        sentences.append(f"In {share:.0%} of all contexts no action is expected to earn half of the reward.")
    if unknown := worth.get("unknown_parameters"):
        names = ", ".join(unknown)
        sentences.append(f"Trials hardly tell the value of {names}: other parameters explain the same trials.")
    for name, share in worth.get("actions_at_end", {}).items():
        if share > NOTABLE:
            sentences.append(f"{share:.0%} of the best actions lie at an end of the range of {name}: widen it.")
    return sentences
