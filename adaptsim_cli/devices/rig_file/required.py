"""What a rig file must state before a real arm moves, or waive in a line that every trial records."""

from __future__ import annotations

from dataclasses import dataclass

from adaptsim_cli.devices.rig_file.description import RigDescription, Waivable


@dataclass(frozen=True)
class Gap:
    """Something that is neither stated nor waived."""

    what: Waivable
    message: str  # what is missing
    remedy: str


def gaps(rig: RigDescription, tool: str) -> tuple[Gap, ...]:
    """The gaps of a rig whose hand holds the tool `tool`, most important first."""
    stated: tuple[tuple[Waivable, bool, str, str], ...] = (
        (
            "pedal",
            rig.pedal is not None,
            "it names no enabling pedal",
            "write its port into [pedal] (docs/guide/enable-pedal.md)",
        ),
        (
            "person",
            rig.person is not None,
            "it does not say where the operator stands, so the arm may move there",
            "write [person] with side and from_m",
        ),
        (
            "payload",
            rig.tool(tool).payload is not None,
            f"it gives no payload for the {tool} tool, so the arm takes its weight for a push",
            f"write [tools.{tool}.payload] with mass_kg and com_F_m",
        ),
        (
            "keep_out",
            bool(rig.keep_out),
            "it names no box that the arm must keep out of",
            "write a [[keep_out]] for each obstacle: stand, lamp, screen",
        ),
    )
    return tuple(Gap(what, says, remedy) for what, is_there, says, remedy in stated if not rig.covers(what, is_there))


def in_words(found: tuple[Gap, ...]) -> str:
    """The gaps in one sentence, with the line that waives them."""
    return "; ".join(f"{gap.message}: {gap.remedy}" for gap in found) + waiving(found)


def waiving(found: tuple[Gap, ...]) -> str:
    """The line that waives the gaps, as the end of a sentence."""
    names = ", ".join(f'"{gap.what}"' for gap in found)
    return f". To go without: waived = [{names}], which every trial records"
