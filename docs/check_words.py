"""Find turns of phrase that have to be read twice: in documents, in the texts that the program prints, and in its code.

    python docs/check_words.py    exit code 1 if there is one; every line names the place and a better wording

Documents are read without code blocks. Of the code, every text is read (help, prompts, messages), every docstring and
every comment; and the templates of the report.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = ("adaptsim_cli", "calib", "hw", "perception", "sim")
MOST_WORDS = 40

PHRASES: tuple[tuple[str, str], ...] = (
    (r"afresh|anew", "again, from the start, new"),
    (r"goes? before `", "overrides"),
    (r"what (?:it )?lacks|what is lacking", "name it: what is missing"),
    (r"(?:is|are) what (?:is|are|was|were|has|had|earned)\b", "say who does it: the session estimates …"),
    (r"what (?:was|were|has been|had been) (?:found|recorded|asked|learnt|measured|in use)", "a noun: the result, …"),
    (r"what the (?:camera|object|arm|hand|person|operator) (?:did|found|saw|says)", "a noun: the detection, …"),
    (r"what mends|mends? (?:it|what|each|that)\b|mended", "remedy, repair, fix"),
    (r"lets? go of is", "the operator releases it"),
    (r"to be late by", "the delay of"),
    (r"(?:is|are|was|be|not) told\b|can be told|as far as known", "stated, known, given"),
    (r"goes on where|went on where", "continues where"),
    (r"that which|of what is\b|with what is\b", "name it"),
    (r"whose \w+ (?:it|they) (?:is|are|was|were)\b", "a noun: the object file for those ranges"),
    (r"19 times (?:of|out of) 20|one \w+ in twenty", "95 %"),
    (r"works but better not", "works, not recommended"),
    (r"there is all, or", "choose all, or"),
    (r"a touch that was none", "a false contact"),
    (r"how unlike", "how far … lies from …"),
    (r"(?:is|are) no (?:path|kind|pose|whole|number|multiple|range|text|table|file|list)\b", "is not a …"),
    (r"looks? (?:whether|which|who)\b|look what\b", "check whether, check what"),
    (r"took no part|take no part", "held-out, left out"),
    (r"once more", "again"),
    (r"as people say", "plain name"),
    (r"otherwise than|(?:sees|looks|ends|ended) otherwise", "differently, another outcome"),
    (r"(?:left|leave it|leaves it|stays) as it (?:is|was)|where it was\?", "unchanged, has not moved"),
    (r"can(?:not)? be had", "is (not) available"),
    (r"does not tell|tells? (?:more|nothing)\b", "report, say"),
    (r"lacks\b", "is missing, has no"),
    (r"(?:is|are) at work in", "is running in"),
    (r"by what|with what all|what (?:it|they) (?:takes?|took|uses?)\b", "a noun: the size, the amount"),
)
"""Pattern -> a better wording."""

_PATTERNS = tuple((re.compile(rf"\b(?:{pattern})", re.IGNORECASE), better) for pattern, better in PHRASES)
_FENCE = re.compile(r"^( *)(```|~~~).*?^\1\2[ ]*$", re.MULTILINE | re.DOTALL)
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_CODE = re.compile(r"`[^`]*`")
_SPLIT = re.compile(r"(?<=[.!?])[)*\"”]*\s+")


def phrases(text: str) -> Iterator[tuple[int, str]]:
    """(offset, complaint) of every phrase of the list in `text`."""
    for pattern, better in _PATTERNS:
        for found in pattern.finditer(text):
            yield found.start(), f'"{found[0]}": better {better}'


def long_sentences(text: str) -> Iterator[tuple[int, str]]:
    """(offset, complaint) of every sentence of Markdown with more than `MOST_WORDS` words, in cells of tables too."""
    for block in re.finditer(r"(?:^(?![#>]).+\n?)+", text, re.MULTILINE):
        items = re.split(r"^\s*(?:[*+-]|\d+[.)])\s+|\|", block[0], flags=re.MULTILINE)
        for sentence in (part for item in items for part in _SPLIT.split(item)):
            words = re.findall(r"[^\W\d_][\w'’-]*", re.sub(r"\]\([^)]*\)|`[^`]*`", " x ", sentence))
            if len(words) > MOST_WORDS:
                start = " ".join(sentence.split()[:6])
                yield block.start() + block[0].find(sentence), f'a sentence of {len(words)} words: "{start} …"'


def prose(text: str) -> str:
    """Markdown without code blocks and comments; every line keeps its number."""
    return _COMMENT.sub(_blank, _FENCE.sub(_blank, text))


def _blank(found: re.Match[str]) -> str:
    return "\n" * found[0].count("\n")


def texts(source: str) -> Iterator[tuple[int, str]]:
    """(line, text) of every text, docstring (without `code`) and comment of a module; of an f-string its fixed parts."""
    tree = ast.parse(source)
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            parts |= {id(part) for part in node.values}
            fixed = [p.value if isinstance(p, ast.Constant) else "…" for p in node.values]
            yield node.lineno, "".join(map(str, fixed))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in parts:
            yield node.lineno, _CODE.sub("…", node.value) if id(node) in docstrings else node.value
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string.removeprefix("#").strip()


def documents() -> list[Path]:
    """Every Markdown file that a reader finds."""
    return sorted((*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")))


def complaints() -> Iterator[str]:
    """One line a finding: path, line, what and better how."""
    for path in documents():
        text = prose(path.read_text(encoding="utf-8"))
        for offset, why in (*phrases(text), *long_sentences(text)):
            yield f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, offset) + 1}: {why}"
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for line, text in texts(path.read_text(encoding="utf-8")):
                for _, why in phrases(text):
                    yield f"{path.relative_to(ROOT)}:{line}: {why}"
        for path in sorted((ROOT / package).rglob("*.j2")):
            text = path.read_text(encoding="utf-8")
            for offset, why in phrases(text):
                yield f"{path.relative_to(ROOT)}:{text.count(chr(10), 0, offset) + 1}: {why}"


def main() -> int:
    found = sorted(set(complaints()))
    print("\n".join(found) if found else "no phrase that has to be read twice")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
