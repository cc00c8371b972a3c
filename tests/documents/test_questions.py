"""Forty questions of a newcomer: each is answered at most two clicks from README, soon on the page that it opens."""

from __future__ import annotations

import os
import re
from collections import deque
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
START = Path("README.md")
LINK = re.compile(r"\]\(([^)#\s]+\.md)(?:#[^)]*)?\)")
COMMENT = re.compile(r"<!--.*?-->")
WORDS_A_SECOND = 4.0
"""Of a reader, from the top of the page or section to the answer."""
MOST_CLICKS, MOST_S = 2, 60.0

CONCEPTS = "docs/start/concepts.md"
QUESTIONS = (
    ("What does it do?", "README.md", "", "adapts a simulator to one table"),
    ("Has it run on a real arm?", "README.md", "", "No real arm, camera, pedal or balance has run this program"),
    ("What do I need to try it?", "README.md", "", "a simulator, and a robot"),
    ("How do I start the demo?", "README.md", "", "make demo"),
    ("Which Python and system?", "README.md", "Install, ask, cite", "Python 3.11"),
    ("What is the licence?", "README.md", "Install, ask, cite", "Apache 2.0"),
    ("Where do I ask?", "README.md", "Install, ask, cite", "open an issue"),
    ("What does adapting gain?", "README.md", "What it gains", "raise the mean reward from"),
    ("What is a particle?", CONCEPTS, "Six words", "an E that moves through a session"),
    ("Whose method is it?", "README.md", "How it works", "is ours"),
    ("What does a reward mean?", CONCEPTS, "The reward", "4 cm away"),
    ("Can I use a UR5?", "docs/start/faq.md", "Questions", "UR5"),
    ("Where can it not work?", "docs/start/faq.md", "Limitations", "One-shot tasks"),
    ("How long does a session take?", "docs/start/faq.md", "Questions", "20 to 40 minutes"),
    ("What do I have to buy?", "docs/guide/what-to-buy.md", "", "Franka Research 3"),
    ("When is Bayesian optimisation better?", "docs/why/beside-others.md", "", "there is no simulator"),
    ("What is UDR?", CONCEPTS, "Six words", "uniform domain randomisation"),
    ("What is the gap?", CONCEPTS, "Six words", "the distance from UDR's reward"),
    ("Why not just fit the simulator?", CONCEPTS, "Why a better simulator alone does not help", "not enough"),
    ("How many trials does a session take?", CONCEPTS, "The loop", "20 trials"),
    ("My pip downloads CUDA. What now?", "docs/start/install.md", "", "TORCH_INDEX"),
    ("Where are my data?", "docs/start/install.md", "Data, upgrade, uninstall", "~/.local/share/adaptsim"),
    ("How do I upgrade or uninstall?", "docs/start/install.md", "Data, upgrade, uninstall", "git pull"),
    ("Is it safe?", "docs/guide/operators-guide.md", "1. Safety", "not a safety system"),
    ("How long until the arm stops?", "docs/guide/operators-guide.md", "How it stops", "at most 0.47 s"),
    ("Which arms and firmware?", "docs/guide/operators-guide.md", "2. What you need", "5.9.0 or newer"),
    ("How large must the table be?", "docs/guide/operators-guide.md", "2. What you need", "0.3 to 1.2 m"),
    ("Where does the camera stand?", "docs/guide/operators-guide.md", "4. Mount and describe", "1.28 m"),
    ("When do I calibrate again?", "docs/guide/operators-guide.md", "Repeat it", "Calibrate again when"),
    ("What does `y` release?", "docs/guide/operators-guide.md", "1. Safety", "releases one motion"),
    ("How do I undo a trial?", "docs/guide/operators-guide.md", "Repeating a trial", "sessions redo"),
    ("Does adapting help on my table?", "docs/guide/operators-guide.md", "Does adapting help here?", "--control udr"),
    ("What does the verdict mean?", "docs/guide/operators-guide.md", "9. Read the report, and use the policy", "Go on"),
    ("A message appeared. What now?", "docs/guide/faults.md", "After a fault", "type `recover`"),
    ("The object is not found.", "docs/guide/operators-guide.md", "10. Trouble", "overlay.jpg"),
    ("Can I use another robot?", "docs/guide/own-robot.md", "", "Any robot"),
    ("How does my program answer?", "docs/guide/own-robot.md", "A program answers", "one JSON object on stdin"),
    ("Can I use my own object?", "docs/guide/own-objects.md", "", "adaptsim object"),
    ("Can I use recorded trials?", "docs/guide/recorded-trials.md", "", "recorded before"),
    ("How do I add a task?", "docs/guide/add-a-task.md", "1. Decide the spaces", "context"),
    ("How do I add a camera?", "docs/guide/add-a-device.md", "A camera", "adaptsim.cameras"),
    ("How do I get the policy out?", "docs/guide/leave.md", "", "sessions policy NAME"),
    ("How do I build my own pedal?", "docs/guide/enable-pedal.md", "The box", "pin 2"),
    ("May I go without a pedal?", "docs/guide/rig.md", "Waivers", "30 days"),
    ("How do I use a cluster?", "docs/guide/beyond-one-computer.md", "Job arrays: no server, no port", "--share"),
    ("What differs from the paper?", "docs/why/paper.md", "Different", "paper"),
    ("Is anything sent or served?", "SECURITY.md", "Security of the program", "127.0.0.1"),
)


@cache
def clicks() -> dict[str, int]:
    """The fewest links from README to each page."""
    distance, queue = {START.as_posix(): 0}, deque([START])
    while queue:
        page = queue.popleft()
        for target in LINK.findall((ROOT / page).read_text("utf-8")):
            linked = Path(os.path.normpath(page.parent / target))
            if linked.as_posix() not in distance and (ROOT / linked).is_file():
                distance[linked.as_posix()] = distance[page.as_posix()] + 1
                queue.append(linked)
    return distance


def read_s(page: str, heading: str, answer: str) -> float:
    """Seconds of reading until the answer, from the top of the page, or from the heading that its contents list shows.

    Raises ValueError where there is no such heading or answer.
    """
    text = COMMENT.sub("", (ROOT / page).read_text("utf-8"))
    if heading:
        begin = re.search(rf"^##+ {re.escape(heading)}$", text, re.MULTILINE)
        if begin is None:
            raise ValueError(f"{page} has no section {heading!r}")
        end = re.search(r"^## ", text[begin.end() :], re.MULTILINE)
        text = text[begin.start() :][: begin.end() - begin.start() + end.start() if end else None]
    return len(text[: text.index(answer)].split()) / WORDS_A_SECOND


def test_no_question_is_asked_twice():
    assert len(QUESTIONS) == len({question for question, *_ in QUESTIONS}) >= 40


@pytest.mark.parametrize(("question", "page", "heading", "answer"), QUESTIONS, ids=[q for q, *_ in QUESTIONS])
def test_it_is_answered_within_two_clicks_and_a_minute(question, page, heading, answer):
    assert clicks()[page] <= MOST_CLICKS
    assert read_s(page, heading, answer) <= MOST_S
