#!/usr/bin/env python3
"""Measures opening and scrubbing of a report in a headless Chromium with software rendering: python scrub.py REPORT.html. Needs Chromium and nothing from PyPI.

Scrubbing shows one frame after the other, each as soon as the browser requests the next picture. The CPU time of its processes is printed too, since it depends
less on other load.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

OPTIONS = ["--headless", "--no-sandbox", "--remote-debugging-pipe", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
           "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1280,1000"]  # fmt: skip
FRAMES = 60
SCRUB = f"""new Promise((done) => {{ let n = 0; const began = performance.now(), step = () => {{
  if (n >= {FRAMES}) return done(performance.now() - began);
  stillpoint.go(n++ * STRIDE); requestAnimationFrame(step); }}; requestAnimationFrame(step); }})"""


class Browser:
    """Chromium, controlled by the DevTools protocol over a pipe."""

    def __init__(self, folder: str) -> None:
        (its_in, our_out), (our_in, its_out) = os.pipe(), os.pipe()

        def prepare() -> None:
            # Chromium reads from 3 and writes to 4; the pipes may have these numbers already.
            os.dup2(its_in, 100)
            os.dup2(its_out, 101)
            os.dup2(100, 3)
            os.dup2(101, 4)

        program = shutil.which("chromium") or shutil.which("google-chrome") or sys.exit("expected chromium on the path, found none; install it")
        command = [program, *OPTIONS, f"--user-data-dir={folder}"]
        self.process = subprocess.Popen(command, close_fds=False, preexec_fn=prepare, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(its_in)
        os.close(its_out)
        self.to, self.come, self.rest, self.number, self.session = our_out, our_in, b"", 0, None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]

    def call(self, method: str, **parameters: Any) -> Any:
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters, **({"sessionId": self.session} if self.session else {})}
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            while b"\0" not in self.rest:
                self.rest += os.read(self.come, 65536) or sys.exit("the browser ended")
            text, self.rest = self.rest.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("id") == self.number:
                return answer["result"]

    def value(self, script: str) -> Any:
        result = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        return sys.exit(f"the page failed: {result}") if "exceptionDetails" in result else result["result"].get("value")

    def worked(self) -> float:
        """CPU time of its processes, s."""
        parents, times = {}, {}
        for stat in Path("/proc").glob("[0-9]*/stat"):
            try:
                fields = re.sub(r"\(.*\)", "x", stat.read_text()).split()
            except OSError:
                continue
            parents[int(fields[0])], times[int(fields[0])] = int(fields[3]), int(fields[13]) + int(fields[14])
        ours = {self.process.pid}
        while more := {p for p, parent in parents.items() if parent in ours} - ours:
            ours |= more
        return sum(times[p] for p in ours) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    page = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        browser = Browser(folder)
        began = time.monotonic()
        browser.call("Page.navigate", url=page.as_uri())
        while browser.value("!!(window.stillpoint && stillpoint.state.ready && page.view.drawn)") is not True:
            time.sleep(0.02)
        print(f"opened in {time.monotonic() - began:.2f} s: {browser.value('JSON.stringify(stillpoint.counts)')}")
        browser.value("document.getElementById('scene').scrollIntoView()")
        for stride in (1, 37):
            for again in ("first", "again"):
                before = browser.worked()
                ms = browser.value(SCRUB.replace("STRIDE", f"{stride} % stillpoint.run.count"))
                print(f"every {stride}. frame, {again}: {1e3 * FRAMES / ms:.1f} frames/s, {1e3 * (browser.worked() - before) / FRAMES:.1f} ms of work each")
        browser.process.kill()
        browser.process.wait()


if __name__ == "__main__":
    main()
