"""Things by name, ours and those of installed packages: tasks, methods, cameras, balances, instruments."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Generic, TypeVar

Thing = TypeVar("Thing")


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
    from importlib.metadata import entry_points  # noqa: PLC0415 - most commands use what is ours

    entries = set[Offer]()
    for entry in entry_points(group=group):
        package, version = (entry.dist.name, entry.dist.version) if entry.dist else ("?", "?")
        entries.add(Offer(group, entry.name, entry.value, package, version))
    return tuple(sorted(entries, key=lambda offer: (offer.name, offer.package, offer.value)))


def did_you_mean(name: str, names: Iterable[str]) -> str:
    """The most similar names as the end of a message; empty if none is similar."""
    near = difflib.get_close_matches(name, list(names), n=3)
    return f"; did you mean {' or '.join(near)}?" if near else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Registry(Generic[Thing]):
    """All things of one kind by name: ours, and those of installed packages. A package is imported on first use."""

    label: str  # what one is called in a message
    group: str  # of the entry points by which packages offer one: its name, and a module
    attribute: str  # of that module, which holds the thing
    ours: Mapping[str, Thing | str]  # each itself, or as an entry point names it: module, or module:attribute
    error: type[Exception]  # raised for an unknown name, and for a package that is not right
    value_type: type | None = None  # of the thing that a package offers; None: a function
    complaint: Callable[[str, Any], str] = lambda name, thing: ""
    """The defect of a thing of that type that is offered under that name; "" if it has none."""

    def names(self) -> tuple[str, ...]:
        """Our names, then those of installed packages."""
        return tuple(dict.fromkeys((*self.ours, *(offer.name for offer in offers(self.group)))))

    def __contains__(self, name: str) -> bool:
        """Whether `names` has it; one of ours is found without reading the entry points of every package."""
        return name in self.ours or self.offer(name) is not None

    def get(self, name: str) -> Thing:
        """The thing called `name`. Raises `error`, naming all there are, or the fault of the package."""
        if name in self.ours:
            return self._our(self.ours[name])
        offer = self.offer(name)
        if offer is None:
            listing = ", ".join(self.names()) or "none"
            near = did_you_mean(name, self.names())
            raise self.error(f'{self.label} "{name}" is not known: it must be one of {listing}{near}')
        if twice := [sentence for sentence in self.clashing() if sentence.startswith(f"{name} of ")]:
            raise self.error(f"{self.label} {twice[0]}")
        try:
            thing: Thing = offer.load(self.attribute)
        except PluginError as error:
            raise self.error(f"{self.label} {error}") from error
        if complaint := self._wrong_type(thing) or self.complaint(name, thing):
            raise self.error(f"{self.label} {offer}: its {self.attribute} {complaint}")
        return thing

    def _wrong_type(self, thing: object) -> str:
        if callable(thing) if self.value_type is None else isinstance(thing, self.value_type):
            return ""
        right = "function" if self.value_type is None else self.value_type.__name__
        return f"is a {type(thing).__name__}, not a {right}"

    def _our(self, thing: Thing | str) -> Thing:
        if not isinstance(thing, str):
            return thing
        module, _, attribute = thing.partition(":")
        loaded: Thing = getattr(import_module(module), attribute or self.attribute)
        return loaded

    def offer(self, name: str) -> Offer | None:
        """The first package's offer of that name; None if no package offers it, or if the name is ours."""
        return None if name in self.ours else next((one for one in offers(self.group) if one.name == name), None)

    def clashing(self) -> tuple[str, ...]:
        """A sentence for each offered name that is one of ours, or that two packages offer."""
        complaints, first = [], dict[str, Offer]()
        for offer in offers(self.group):
            if offer.name in self.ours:
                complaints.append(f"{offer} has the name of a built-in one, which is used instead: rename it")
            elif offer.name in first:
                complaints.append(f"{offer} is offered by {first[offer.name].package} too: uninstall one of them")
            first.setdefault(offer.name, offer)
        return tuple(complaints)
