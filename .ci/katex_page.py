#!/usr/bin/env python3
"""Opens a page of the reference in headless Chromium and checks that its formulas are rendered.

    katex_page.py PAGE.html ...

KaTeX comes from the npm registry, in the version that docs/katex-header.html names, and takes the place of the one that the page would
load from the network.
Exit code 0: every formula is rendered; 1: one is not; 77: there is no Chromium or no npm here.
"""
import base64
import hashlib
import http.server
import pathlib
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import threading

from report_pages import NAMES, Browser

HEADER = pathlib.Path(__file__).parent.parent / "docs" / "katex-header.html"
ASSET = re.compile(r'"https://[^"]*/(katex@[\d.]+)/(dist/[^"]*)" integrity="sha384-([^"]*)" crossorigin="anonymous"')
TYPES = {".css": "text/css", ".js": "text/javascript", ".html": "text/html; charset=utf-8"}
# Formulas that no element of KaTeX holds: code is shown as it is written.
RAW = r"""
(() => {
  const raw = [];
  const walker = document.createTreeWalker(document.querySelector("main"), NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (parent.closest("pre, code, .katex")) continue;
    if (/\\[()\[\]]|\\(frac|sigma|sum|mu|text)\b/.test(walker.currentNode.data)) raw.push(walker.currentNode.data.trim());
  }
  return {
    raw,
    failed: [...document.querySelectorAll(".katex-error")].map(e => e.textContent),
    rendered: document.querySelectorAll(".katex").length,
  };
})()
"""


def katex(version, folder):
    """The package of that version, unpacked."""
    done = subprocess.run(["npm", "pack", version, "--silent"], cwd=folder, capture_output=True, text=True, timeout=120)
    archives = list(pathlib.Path(folder).glob("katex-*.tgz"))
    if done.returncode or not archives:
        return None
    with tarfile.open(archives[0]) as archive:
        archive.extractall(folder, filter="data")
    return pathlib.Path(folder) / "package"


def serve(roots):
    """A server of those folders by the first part of the path, and its address."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            first, _, rest = self.path.lstrip("/").partition("/")
            path = roots.get(first, pathlib.Path("/nowhere")) / rest.partition("?")[0]
            if not path.is_file():
                self.send_error(404)
                return
            body = path.read_bytes()
            if path.suffix == ".html":
                body = ASSET.sub(lambda m: f'"/katex/{m[2]}"', body.decode()).encode()
            self.send_response(200)
            self.send_header("Content-Type", TYPES.get(path.suffix, "application/octet-stream"))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return server, f"http://127.0.0.1:{server.server_port}"


def check(browser, address):
    """What is wrong with a page, in words."""
    target = browser.call("Target.createTarget", url="about:blank")["targetId"]
    session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    browser.call("Page.enable", session)
    browser.call("Page.navigate", session, url=address)
    while not any(event.get("method") == "Page.loadEventFired" for event in browser.events):
        browser.events.append(browser.message())
    browser.events.clear()
    found = browser.call("Runtime.evaluate", session, expression=RAW, returnByValue=True)["result"]["value"]
    faults = [f"raw TeX: {text}" for text in found["raw"]] + [f"not understood: {text}" for text in found["failed"]]
    if not found["rendered"]:
        faults.append("no formula is rendered")
    return found["rendered"], faults


def main():
    program = next((found for found in map(shutil.which, NAMES) if found), None)
    if not program or not shutil.which("npm"):
        print("skipped: there is no Chromium or no npm")
        return 77
    assets = ASSET.findall(HEADER.read_text())
    assert len(assets) == 3, "the header's links are not what is expected"
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as profile:
        package = katex(assets[0][0], folder)
        if package is None:
            print(f"skipped: npm can't fetch {assets[0][0]}")
            return 77
        for _, path, digest in assets:
            own = base64.b64encode(hashlib.sha384((package / path).read_bytes()).digest()).decode()
            assert own == digest, f"{path}: the header's hash is not that of the package"
        pages = [pathlib.Path(page).resolve() for page in sys.argv[1:]]
        root = next(parent for parent in pages[0].parents if parent.name == "doc")
        server, address = serve({"doc": root, "katex": package})
        browser = Browser(program, profile)
        wrong = 0
        for page in pages:
            count, faults = check(browser, f"{address}/doc/{page.relative_to(root)}")
            print(f"{page.relative_to(root)}: {count} formulas, {len(faults)} faults")
            for fault in faults:
                print(f"  {fault}")
            wrong += len(faults)
        browser.close()
        server.shutdown()
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
