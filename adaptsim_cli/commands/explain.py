"""`adaptsim explain`."""

from __future__ import annotations

from typing import Annotated

import typer

from adaptsim_cli.commands.command import command
from adaptsim_cli.screen.reply import Reply

SHOWN = 3
"""At most this many messages that look alike."""


@command(with_json=False)
def explain(
    message: Annotated[str, typer.Argument(help="The message, or a part of it, in quotes.")],
) -> Reply:
    """Say what a message means: what happened, what the arm did, and what to do next.

    Example: adaptsim explain "the enabling pedal was released"
    """
    from adaptsim_cli.errors import UsageError
    from adaptsim_cli.screen import exit_codes, messages
    from adaptsim_cli.screen.pages import addressed

    kinds = messages.error_kinds(exit_codes.documented_errors())
    alike = messages.nearest(message, messages.all_messages(frozenset(kinds)), SHOWN)
    if not alike:
        raise UsageError(
            f"no message of this version is like {message!r}: copy a whole sentence of it. "
            f"{addressed('docs/guide/faults.md')} lists faults of an arm"
        )
    lines = []
    for number, one in enumerate(alike):
        lines += [""] if number else []
        lines.append(one.template)
        if one.kind:
            kind = kinds[one.kind]
            code = exit_codes.exit_code(kind(""))
            lines.append(f"  Kind: {one.kind}, exit code {code}. {messages.meaning_of(kind)}")
            lines.append(f"  Next: {messages.ADVICE[code]}")
        else:
            lines.append(f"  A cause that is part of several messages: {addressed('docs/guide/faults.md')}")
        lines.append(f"  From {one.place}")
    return Reply(text=lines)
