"""A session as the last line of a notebook's cell: its rewards, its verdict, and its learning curve."""

from __future__ import annotations

from base64 import b64encode
from html import escape

from adaptsim_cli.api.curves import curve_of
from adaptsim_cli.api.tables import html_table
from adaptsim_cli.screen.views import between
from adaptsim_cli.session.advice import gain_in_words
from adaptsim_cli.session.store import SessionStore
from adaptsim_cli.show import figures
from adaptsim_cli.show.figures import Level

WIDTH = 460.0
_STYLE = (
    "<style>text{font:12px sans-serif;fill:#777}.grid{stroke:#8884}.curve{fill:none;stroke:#2a66a8;stroke-width:2}"
    ".dot{fill:#2a66a8}.interval{stroke:#2a66a8;stroke-width:1.5;opacity:.5}</style>"
)
"""The style of a picture that has no page of its own, for a light or a dark notebook."""


def session_in_html(store: SessionStore, title: str, verdict: str) -> str:
    """The session for a notebook. Raises SessionError."""
    curve = curve_of(store)
    if not curve:
        return f"<p>{escape(title)}</p>"
    earned = gain_in_words([float(row["mean_reward"]) for row in curve])
    sentences = [f"<b>{earned}.</b>", escape(verdict)]
    body = [
        [
            str(row["iteration"]),
            str(row["trials"]),
            f"{row['mean_reward']:.2f}",
            between(float(row["low"]), float(row["high"])),
        ]
        for row in curve
    ]
    table = html_table(["iteration", "trials so far", "mean reward", "95 % interval"], body)
    levels = [
        Level(store.facts.name, "", "", float(row["mean_reward"]), float(row["low"]), float(row["high"]), "c0")
        for row in curve
    ]
    drawn = figures.lines([levels], WIDTH).replace(">", f' xmlns="http://www.w3.org/2000/svg">{_STYLE}', 1)
    source = f"data:image/svg+xml;base64,{b64encode(drawn.encode()).decode()}"
    picture = f'<img width="{WIDTH:.0f}" alt="Mean reward of every iteration" src="{source}">'
    return f"<p>{escape(title)}</p><p>{' '.join(sentences)}</p>{picture}{table}"
