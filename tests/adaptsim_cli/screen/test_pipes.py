"""A reader that leaves its pipe never ends a command."""

from __future__ import annotations

import os
import subprocess
import sys

from adaptsim_cli.screen.pipes import PipeOutput

INTERRUPTED_WHILE_LOADING = """
import builtins, os, signal
load = builtins.__import__
def interrupted(name, *rest, **named):
    if name == "adaptsim_cli.commands":
        os.kill(os.getpid(), signal.SIGINT)
    return load(name, *rest, **named)
builtins.__import__ = interrupted
from adaptsim_cli.__main__ import main
main()
"""


def test_what_nobody_reads_counts_as_written():
    reader, writer = os.pipe()
    output = PipeOutput(writer, "wb")
    assert output.write(b"seen") == 4
    assert os.read(reader, 9) == b"seen"
    os.close(reader)
    assert output.write(b"unseen") == 6
    output.close()


def test_a_command_ends_as_usual_after_its_reader_has_left():
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-m", "adaptsim_cli", "config", "path"]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_an_interrupt_while_the_program_loads_shows_no_traceback():
    command = [sys.executable, "-c", INTERRUPTED_WHILE_LOADING]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (130, "\nInterrupted; nothing had begun.\n")
