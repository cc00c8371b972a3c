"""Find pages of the built site that are wider than a phone: `make check-site` runs it.

    python docs/check_site.py build/site    exit code 1 if a page has to be scrolled sideways; every line names one

Needs Chromium or Chrome. It lays out every page in a frame as wide as a phone and compares widths.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PHONE_PX = 420
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
PATIENCE_S = 600.0

_PAGE = """<!doctype html>
<body><pre id="found"></pre><script>
const pages = %s;
async function width(page) {
  const frame = document.createElement("iframe");
  frame.sandbox = "allow-same-origin";  // no scripts: the search of the site never comes to rest
  frame.style = "width: %dpx; height: 800px; border: 0";
  await new Promise(loaded => { frame.onload = loaded; frame.src = page; document.body.append(frame); });
  const wide = frame.contentDocument.documentElement.scrollWidth;
  frame.remove();
  return wide;
}
(async () => {
  for (const page of pages) document.getElementById("found").append(`${await width(page)} ${page}\\n`);
  document.getElementById("found").append("all pages seen");
})();
</script></body>
"""


def widths(site: Path, browser: str) -> dict[str, int]:
    """Page -> how wide it is laid out on a phone, in pixels. Raises SystemExit where the browser does not answer."""
    pages = sorted(path.resolve().as_uri() for path in site.rglob("*.html"))
    if not pages:
        raise SystemExit(f"{site} holds no pages: build them with make site")
    with tempfile.TemporaryDirectory() as folder:
        start = Path(folder) / "check.html"
        start.write_text(_PAGE % (json.dumps(pages), PHONE_PX), encoding="utf-8")
        flags = ("--headless", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files")
        done = subprocess.run(
            [browser, *flags, f"--user-data-dir={folder}/profile", "--virtual-time-budget=60000", "--dump-dom", start],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
    if "all pages seen</pre>" not in done.stdout:
        raise SystemExit(f"{browser} did not look at all pages:\n{done.stderr[-2000:]}")
    return {page: int(px) for px, page in re.findall(r"(\d+) (file:\S+\.html)\n", done.stdout)}


def main(arguments: list[str]) -> int:
    site = Path(arguments[0] if arguments else "build/site")
    browser = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if browser is None:
        raise SystemExit(f"no browser: install one of {', '.join(BROWSERS)}")
    found = widths(site, browser)
    wide = {page: px for page, px in found.items() if px > PHONE_PX}
    for page, px in sorted(wide.items()):
        print(f"{page.removeprefix(site.resolve().as_uri() + '/')}: {px} px wide, a phone has {PHONE_PX}")
    if not wide:
        print(f"all {len(found)} pages fit a phone")
    return 1 if wide else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
