"""What the current folder decides about a real arm: its settings, and a rig file that is not the user's own."""

from __future__ import annotations

from pathlib import Path

from adaptsim_cli.bench.rig_file.description import RigDescription
from adaptsim_cli.bench.rig_file.reading import read, tasks_with_tools
from adaptsim_cli.config import Config, Places
from adaptsim_cli.trust import RIG, FileClaim, settings_claims


def rig_claims(config: Config, where: Places) -> tuple[FileClaim, ...]:
    """The claims of the current folder on a real arm. Raises UsageError for a file that cannot be read."""
    settings = settings_claims(where)
    if config.rig_is_own or not config.rig:
        return settings
    file = Path(config.rig)
    claim = FileClaim.of_files(RIG, [file], "")
    rig = read(file, tasks_with_tools())
    pedal = "no pedal" if rig.pedal is None else f"a pedal at {rig.pedal.port}"
    waivers = ", ".join(waiver.safeguard for waiver in rig.waivers) or "none"
    meaning = (
        f"It describes the {rig.arm.model} at {rig.arm.address}: {boxes_in_words(rig)}; {pedal}; one answer releases "
        f"one {rig.consent or 'motion'}. Its waivers ({waivers}) do not count, and the arm's memory and the "
        "calibrations of your own rig file are not used."
    )
    return (*settings, FileClaim(RIG, claim.place, claim.content, meaning))


def boxes_in_words(rig: RigDescription) -> str:
    """The keep-out boxes of a rig, by name."""
    return f"boxes: {', '.join(box.name for box in rig.boxes()) or 'none'}"


def in_one_sentence(config: Config, rig: RigDescription) -> str:
    """The rig file of the settings with its boxes and waivers, for the question before an arm may move."""
    waived = ", ".join(waiver.safeguard for waiver in rig.in_force()) or "none"
    foreign = "" if config.rig_is_own else " of the current folder, whose waivers do not count"
    return f"Rig file {config.rig}{foreign}; {boxes_in_words(rig)}; waived: {waived}."
