"""What installed packages offer by entry points: tasks and cameras. Each is imported on first use."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any


class PluginError(Exception):
    """A package offers something that cannot be loaded; the message names package, version and entry point."""


@dataclass(frozen=True)
class Offer:
    """One entry point of an installed package."""

    group: str
    name: str
    value: str  # module, or module:attribute
    package: str
    version: str

    def __str__(self) -> str:
        return f"{self.name} of {self.package} {self.version} (entry point {self.group}: {self.name} = {self.value})"

    @property
    def module(self) -> str:
        """The name of its module."""
        return self.value.partition(":")[0].strip()

    def origin(self) -> Path | None:
        """The file of its module; None if it cannot be found without an error, which `load` reports."""
        try:
            spec = find_spec(self.module)
        except (ImportError, SyntaxError, ValueError):  # a parent package is imported for it; `load` reports it
            return None
        return None if spec is None or spec.origin is None else Path(spec.origin)

    def load(self, attribute: str) -> Any:
        """The attribute that the entry point names, or `attribute` of its module. Raises PluginError."""
        name = self.value.partition(":")[2].strip() or attribute
        try:
            return getattr(import_module(self.module), name)
        except AttributeError as error:
            raise PluginError(f"{self}: {self.module} has no {name}: {error}") from error
        except (Exception, SystemExit) as error:  # whatever a foreign module does when it is imported
            reason = f"{type(error).__name__}: {error}".rstrip(": ")
            raise PluginError(f"{self} cannot be imported: {reason}. Mend the package, or uninstall it") from error


@cache
def offers(group: str) -> tuple[Offer, ...]:
    """The entry points of a group, by name and package."""
    entries = {
        Offer(
            group,
            entry.name,
            entry.value,
            entry.dist.name if entry.dist else "?",
            entry.dist.version if entry.dist else "?",
        )
        for entry in entry_points(group=group)
    }
    return tuple(sorted(entries, key=lambda offer: (offer.name, offer.package, offer.value)))


def clashes(group: str, ours: frozenset[str] | set[str]) -> tuple[str, ...]:
    """A sentence for each offered name that is one of `ours`, or that two packages offer."""
    complaints, first = [], dict[str, Offer]()
    for offer in offers(group):
        if offer.name in ours:
            complaints.append(f"{offer} has the name of a built-in one, which is used instead: rename it")
        elif offer.name in first:
            complaints.append(f"{offer} is offered by {first[offer.name].package} too: uninstall one of them")
        first.setdefault(offer.name, offer)
    return tuple(complaints)
