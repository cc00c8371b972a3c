"""Make the picture at the head of README.md from the report of a session: verdict, rewards and one trial.

    python docs/session_picture.py SESSION --trial 5

The report is the one that `adaptsim report` writes; a browser shows it with its other sections hidden. Writes
docs/figures/session.png. Needs the browser and the packages of `make check-live`.
"""

from __future__ import annotations

import argparse
import base64
import json
import subprocess
from pathlib import Path

from check_live import adaptsim, tab

PICTURE = Path(__file__).parent / "figures/session.png"
WIDTH_PX = 940
_SHORTEN = """
(trial => {
  const chosen = [...document.querySelectorAll("article.trial")].find(
    one => one.querySelector("h3").textContent.trim().split(/\\s+/)[1] === `${trial}`);
  if (!chosen) return 0;
  for (const one of document.querySelectorAll("section, header .figures, header .best")) {
    const rewards = one.querySelector("h2") && one.querySelector("h2").textContent.trim() === "Reward";
    if (!rewards && !one.contains(chosen)) one.remove();
  }
  for (const one of [...chosen.parentElement.children]) if (one !== chosen) one.remove();
  for (const one of chosen.querySelectorAll("details")) one.remove();
  const style = document.createElement("style");
  style.textContent = "main { padding: 1rem 1.6rem; max-width: none } section { margin-top: 0.5rem; padding-top: 0 }";
  document.head.append(style);
  return Math.ceil(document.querySelector("main").getBoundingClientRect().height);
})"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", help="name of a session with a report")
    parser.add_argument("--trial", type=int, required=True, help="the trial whose camera pictures are shown")
    wanted = parser.parse_args()
    said = subprocess.run(adaptsim("report", wanted.session, "--json"), check=False, stdout=subprocess.PIPE, text=True)
    if said.returncode:
        return said.returncode
    report = Path(json.loads(said.stdout)["report"])
    with tab(PICTURE.parent) as page:
        page.ask("Emulation.setDeviceMetricsOverride", width=WIDTH_PX, height=900, deviceScaleFactor=1, mobile=False)
        page.open(report.as_uri())
        height = page.script(f"{_SHORTEN}({wanted.trial})")
        if not height:
            raise SystemExit(f"{report} has no trial {wanted.trial}")
        clip = {"x": 0, "y": 0, "width": WIDTH_PX, "height": height, "scale": 1}
        shot = page.ask("Page.captureScreenshot", captureBeyondViewport=True, format="png", clip=clip)
    PICTURE.write_bytes(base64.b64decode(shot["data"]))
    print(f"{PICTURE}: {WIDTH_PX} x {height} px")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
