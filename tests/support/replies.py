"""The replies of commands, as a program reads them."""

from __future__ import annotations

import json
from typing import Any

from adaptsim_cli.screen.outputs import catalogue
from adaptsim_cli.screen.reply import Reply


def output(command: str, reply: Reply) -> Any:
    """Its JSON."""
    assert reply.data is not None
    return json.loads(json.dumps(catalogue.output(command, reply.data), allow_nan=False))


def refused(command: str, reply: Reply, *words: str) -> Any:
    """Its JSON, of a result that ends the command with an error of these words."""
    assert reply.failure is not None
    message = "\n".join([str(reply.failure), *getattr(reply.failure, "__notes__", ())])
    assert all(word in message for word in words), message
    return output(command, reply)
