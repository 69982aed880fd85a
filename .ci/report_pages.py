#!/usr/bin/env python3
"""Opens report pages in headless Chromium and checks that they do what they say.

    report_pages.py PAGE.html ... [--shots FOLDER]

Speaks the DevTools protocol over a pair of pipes, so that Python's own library is enough. Installs nothing.
Exit code 0: all checks hold; 1: one does not; 77: there is no Chromium here.
"""
import argparse
import base64
import json
import os
import pathlib
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time

NAMES = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable"]
SIZES = {"wide": (1280, 900), "phone": (390, 844)}
PATIENCE = 30  # seconds that a page or an answer may take


class Silent(Exception):
    """The browser itself failed."""


class Browser:
    """A headless Chromium and the calls that it answers."""

    def __init__(self, program, profile):
        to_read, self.to = os.pipe()
        self.source, to_write = os.pipe()

        def wire():
            # Numbers above 4 first: one of the two may be 3 or 4 itself.
            reading, writing = os.dup(to_read), os.dup(to_write)
            os.dup2(reading, 3)
            os.dup2(writing, 4)

        arguments = [program, "--headless=new", "--remote-debugging-pipe", "--no-first-run", "--disable-gpu",
                     "--disable-background-networking", "--hide-scrollbars", f"--user-data-dir={profile}", "about:blank"]
        if os.geteuid() == 0:
            arguments.insert(1, "--no-sandbox")
        self.process = subprocess.Popen(arguments, preexec_fn=wire, close_fds=False,
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(to_read)
        os.close(to_write)
        self.buffer, self.events, self.count = b"", [], 0

    def message(self):
        """The next message of the browser."""
        end = time.monotonic() + PATIENCE
        while b"\0" not in self.buffer:
            if not select.select([self.source], [], [], max(0, end - time.monotonic()))[0]:
                raise Silent("the browser says nothing")
            part = os.read(self.source, 1 << 20)
            if not part:
                raise Silent("the browser went away")
            self.buffer += part
        text, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(text)

    def call(self, method, session=None, **parameters):
        """The answer to a call; events that come before it are kept."""
        self.count += 1
        call = {"id": self.count, "method": method, "params": parameters}
        if session:
            call["sessionId"] = session
        os.write(self.to, json.dumps(call).encode() + b"\0")
        while True:
            message = self.message()
            if message.get("id") == self.count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self.events.append(message)

    def close(self):
        try:
            self.call("Browser.close")
        except (Silent, OSError):
            pass
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class Page:
    """One page in a tab of its own."""

    def __init__(self, browser, path, size, scheme):
        self.browser = browser
        target = browser.call("Target.createTarget", url="about:blank")["targetId"]
        self.target = target
        self.session = browser.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        width, height = size
        self.phone = width < 600
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=2 if self.phone else 1, mobile=self.phone)
        self.call("Emulation.setTouchEmulationEnabled", enabled=self.phone)
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        browser.events.clear()
        self.call("Page.navigate", url=pathlib.Path(path).resolve().as_uri())
        self.wait("document.documentElement?.dataset.ready !== undefined")
        self.settle()

    def call(self, method, **parameters):
        return self.browser.call(method, self.session, **parameters)

    def value(self, expression):
        """What a JavaScript expression gives; promises are awaited."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{expression}: {answer['exceptionDetails']}")
        return answer["result"].get("value")

    def wait(self, expression):
        end = time.monotonic() + PATIENCE
        while not self.value(expression):
            if time.monotonic() > end:
                raise TimeoutError(expression)
            time.sleep(0.05)

    def settle(self):
        """Waits until what was asked to be drawn is drawn."""
        self.value("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def complaints(self):
        """Errors in the console, exceptions, and requests that leave the page."""
        self.value("1")
        found = []
        for event in self.browser.events:
            what, body = event.get("method"), event.get("params", {})
            if what == "Runtime.exceptionThrown":
                found.append(body["exceptionDetails"].get("exception", {}).get("description", "exception"))
            elif what == "Runtime.consoleAPICalled" and body["type"] in ("error", "warning", "assert"):
                found.append(" ".join(str(a.get("value", a.get("description"))) for a in body["args"]))
            elif what == "Log.entryAdded" and body["entry"]["level"] in ("error", "warning"):
                found.append(body["entry"]["text"])
            elif what == "Network.requestWillBeSent" and not body["request"]["url"].startswith(("file:", "data:", "blob:")):
                found.append(f"asks for {body['request']['url']}")
        return found

    def box(self, selector):
        """Where an element is in the window, after scrolling it there."""
        self.value(f"document.querySelector({json.dumps(selector)}).scrollIntoView({{block: 'center'}})")
        self.settle()
        return self.value(f"(() => {{ const b = document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
                          "return [b.left, b.top, b.width, b.height]; })()")

    def mouse(self, kind, x, y, **more):
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start, end):
        self.mouse("mousePressed", *start, button="left", buttons=1, clickCount=1)
        self.mouse("mouseMoved", *end, button="left", buttons=1)
        self.mouse("mouseReleased", *end, button="left", clickCount=1)
        self.settle()

    def key(self, key):
        code = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "0": 48}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code)
        self.settle()

    def pixels(self, selector):
        """A canvas as a text that differs where the pictures do."""
        return self.value(f"document.querySelector({json.dumps(selector)}).toDataURL()")

    def shot(self, path):
        size = self.call("Page.getLayoutMetrics")["cssContentSize"]
        clip = {"x": 0, "y": 0, "width": size["width"], "height": min(size["height"], 12000), "scale": 1}
        data = self.call("Page.captureScreenshot", captureBeyondViewport=True, clip=clip)["data"]
        path.write_bytes(base64.b64decode(data))

    def close(self):
        self.browser.call("Target.closeTarget", targetId=self.target)


def check(holds, what):
    if not holds:
        raise AssertionError(what)


def check_any(page):
    """What every page promises."""
    check(page.value("document.documentElement.dataset.ready") == "yes", "the page says that it could not be drawn")
    wide = page.value("[document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    check(wide[0] <= wide[1], f"the page is {wide[0]} px wide in a window of {wide[1]} px")
    nameless = page.value("[...document.querySelectorAll('button, select, input, canvas, img')].filter((e) => !(e.ariaLabel ||"
                          " e.alt || e.textContent.trim() || e.closest('label')?.textContent.trim() || e.closest('button')?.ariaLabel)).map((e) => e.outerHTML)")
    check(nameless == [], f"elements without a name: {nameless}")
    # Read by the same rule that a reader's eye uses: ink against paper.
    light = page.value("(() => { const c = (e, k) => getComputedStyle(e)[k].match(/[0-9.]+/g).slice(0, 3).reduce((s, v) => s + +v, 0);"
                       "return [c(document.body, 'color'), c(document.body, 'backgroundColor')]; })()")
    check(abs(light[0] - light[1]) > 450, f"ink and paper are too alike: {light}")
    return light[1] > light[0]


def check_tables(page):
    """Headings stand over what they name; on a wide screen nothing has to be scrolled to."""
    uneven = page.value("[...document.querySelectorAll('table')].filter((t) => new Set([...t.rows].map((r) =>"
                        "[...r.cells].reduce((sum, c) => sum + c.colSpan, 0))).size > 1).map((t) => t.textContent.slice(0, 60))")
    check(uneven == [], f"tables with rows of different widths: {uneven}")
    if not page.phone:
        cut = page.value("[...document.querySelectorAll('.narrow')].filter((e) => e.scrollWidth > e.clientWidth).map((e) => e.ariaLabel)")
        check(cut == [], f"tables that are cut off: {cut}")
    parted = page.value("[...document.querySelectorAll('.card b, .card span')].filter((e) => /[0-9] %/.test(e.textContent)).map((e) => e.textContent)")
    check(parted == [], f"a line may end between a number and its unit: {parted}")


def reading(page):
    """What the pixel under the pointer is said to have."""
    return page.value("Object.fromEntries([...document.querySelectorAll('#readout dd')].map((d) => [d.dataset.name, d.textContent]))")


def check_run(page, folder):
    """Slider, hover, keyboard and cloud of a run's page."""
    check(reading(page) == {}, "values stand there before a pixel is chosen")
    check_hover(page, folder)
    check_tables(page)
    left, top, width, height = page.box("#viewer")
    before = page.pixels("#viewer")
    page.drag((left + 0.5 * width, top + 0.5 * height), (left + 0.2 * width, top + 0.5 * height))
    check(abs(int(page.value("document.getElementById('split').value")) - 200) <= 5, "dragging does not move the slider")
    dragged = page.pixels("#viewer")
    check(dragged != before, "dragging does not change the picture")
    page.value("document.getElementById('split').focus()")
    at = int(page.value("document.getElementById('split').value"))
    page.key("ArrowRight")
    check(int(page.value("document.getElementById('split').value")) > at, "the arrow keys do not move the slider")
    page.value("(() => { const s = document.getElementById('split'); s.value = 800; s.dispatchEvent(new Event('input')); })()")
    page.settle()
    check(page.pixels("#viewer") != dragged, "the slider does not change the picture")
    check_halves(page)

    page.value("document.getElementById('viewer').focus()")
    place = reading(page)["pixel"]
    page.key("ArrowDown")
    check(reading(page)["pixel"] != place, "the arrow keys do not move the pixel")

    record = "JSON.parse(document.getElementById('data').textContent).record"
    known = page.value(f"{record}.prior?.source !== 'none'")
    check(page.value("document.querySelectorAll('.first canvas').length") == 3 + known, "photograph, prior, depth and sigma are not side by side")
    seconds = page.value("[...document.querySelectorAll('[aria-label=seconds] td')].map((d) => +d.textContent)")
    check(abs(sum(seconds[:-1]) - seconds[-1]) < 0.01 * len(seconds), f"the stages do not sum to the whole: {seconds}")
    check_distance(page)
    check_zoom(page, load(folder / "depth.npy")[0])
    linked = page.value("[...document.querySelectorAll('.gallery a[download]')].map((a) => a.getAttribute('href'))")
    check("depth.npy" in linked and "sigma.npy" in linked, f"the maps are linked to {linked}")
    check(page.value("document.querySelectorAll('.histogram rect').length") == 96, "there are no histograms")

    plain = page.pixels("#viewer")
    page.value("document.getElementById('edges-refined').click()")
    page.settle()
    check(page.pixels("#viewer") != plain, "the edges are not drawn")
    page.value("document.getElementById('edges-refined').click()")

    left, top, width, height = page.box("#cloud")
    seen = page.pixels("#cloud")
    middle = (left + 0.5 * width, top + 0.5 * height)
    page.drag(middle, (middle[0] + 60, middle[1] + 5))
    turned = page.pixels("#cloud")
    check(turned != seen, "dragging does not turn the cloud")
    page.mouse("mouseWheel", *middle, deltaX=0, deltaY=-200)
    page.wait("true")
    page.settle()
    zoomed = page.pixels("#cloud")
    check(zoomed != turned, "the wheel does not zoom the cloud")
    page.value("document.getElementById('cloud').focus()")
    page.key("ArrowLeft")
    check(page.pixels("#cloud") != zoomed, "the arrow keys do not turn the cloud")
    points = "+document.getElementById('cloud-count').textContent.replaceAll(',', '').split(' ')[0]"
    counted = page.value(points)
    every = int(page.value("document.getElementById('cloud-count').textContent").replace(",", "").split()[2])
    check(every > 100 and 0.7 * every < counted < 0.9 * every, f"the cloud opens with {counted} of {every} points")
    page.value("(() => { const s = document.getElementById('cloud-sigma'); s.value = 50; s.dispatchEvent(new Event('input')); })()")
    page.settle()
    some = page.value(points)
    check(0.3 * every < some < 0.7 * every, f"half of the sigmas hides {every - some} of {every} points")
    page.value("(() => { const s = document.getElementById('cloud-sigma'); s.value = 100; s.dispatchEvent(new Event('input')); })()")
    page.settle()
    unturned = page.pixels("#cloud")
    for shape in ("surface", "points"):
        page.value("(() => { const s = document.querySelector('select[aria-label=\"Points or a surface\"]');"
                   f"s.value = '{shape}'; s.dispatchEvent(new Event('change')); }})()")
        page.settle()
        check((page.pixels("#cloud") == unturned) == (shape == "points"), f"the depth as {shape} looks wrong")
    page.value("document.getElementById('cloud').focus()")
    page.key("0")
    check(page.pixels("#cloud") != unturned, "0 does not bring the cloud back")
    # A run that fitted no field has none.
    fitted = page.value("JSON.parse(document.getElementById('data').textContent).record.training.length")
    curves = page.value("document.querySelectorAll('.chart polyline').length")
    check((curves >= 2) == (fitted > 0), f"{curves} training curves for {fitted} fits")


    if (folder / "views").is_dir():
        check_photographs(page, folder)


def check_distance(page):
    """Two points have a distance with an error bar; the border stays where it is."""
    at = page.value("document.getElementById('split').value")
    page.value("document.getElementById('measure').click()")
    left, top, width, height = page.box("#viewer")
    for u, v in ((0.3, 0.6), (0.7, 0.7)):
        point = (left + u * width, top + v * height)
        page.drag(point, point)
    said = reading(page)["distance"].split()
    check(len(said) >= 3 and said[1] == "±" and float(said[0]) > 0 and float(said[2]) > 0, f"the distance is {said}")
    check(page.value("document.getElementById('split').value") == at, "measuring moves the border")
    page.value("document.getElementById('measure').click()")
    check("distance" not in reading(page), "the distance stays after measuring")


def check_zoom(page, size):
    """The middle of the maps, larger: the read-out follows, dragging moves it, and the border stays."""
    (rows, columns), at = size, "document.getElementById('split').value"
    before, split = page.pixels("#viewer"), page.value(at)
    left, top, width, height = page.box("#viewer")
    page.mouse("mouseMoved", left + 0.25 * width, top + 0.25 * height)
    page.settle()
    plain = page.pixels("#viewer")
    page.value("document.getElementById('zoom-in').click()")
    page.mouse("mouseMoved", left + 0.25 * width, top + 0.25 * height)
    page.settle()
    zoomed = page.pixels("#viewer")
    check(zoomed not in (plain, before), "zooming does not change the picture")

    def near(u, v):
        x, y = map(int, reading(page)["pixel"].split(", "))
        return abs(x - u * columns) <= 3 + columns / 320 and abs(y - v * rows) <= 3 + rows / 320

    check(near(1 / 3, 1 / 3), f"a quarter into 2/3 of the maps is said to be {reading(page)['pixel']}")
    page.drag((left + 0.25 * width, top + 0.25 * height), (left + 0.4 * width, top + 0.25 * height))
    check(near(1 / 3, 1 / 3) and page.value(at) == split, f"the picture does not follow the pointer: {reading(page)['pixel']}")
    page.mouse("mouseWheel", left + 0.4 * width, top + 0.25 * height, deltaX=0, deltaY=-200, modifiers=2)
    page.settle()
    check(near(1 / 3, 1 / 3), f"the wheel does not zoom about the pointer: {reading(page)['pixel']}")
    page.value("document.getElementById('zoom-whole').click()")
    page.mouse("mouseMoved", left + 0.25 * width, top + 0.25 * height)
    page.settle()
    check(page.pixels("#viewer") == plain, "the whole does not come back")


def check_photographs(page, folder):
    """Thumbnails, evidence and novel view of a run with several photographs."""
    loaded = page.value("Promise.all([...document.images].map((i) => i.decode())).then(() =>"
                        "[...document.images].every((i) => i.naturalWidth > 0))")
    check(loaded, "a picture is broken")
    shown = page.value("document.querySelectorAll('.photographs img').length")
    expected = len([path for path in (folder / "views").glob("*.png") if path.stem.isdigit()])
    check(shown == expected, f"{shown} thumbnails of {expected} photographs")
    chips = page.value("[...document.querySelectorAll('.photographs .chip')].map((c) => c.textContent)")
    check(chips.count("reference") == 1, f"the photographs are {chips}")
    clipped = page.value("[...document.querySelectorAll('.photographs figcaption *')].filter((e) => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline').map((e) => e.textContent)")
    check(clipped == [], f"captions that are cut off: {clipped}")
    if (folder / "evidence.npz").exists():
        keys = page.value("document.querySelectorAll('.split > .key-list li').length")
        check(keys >= 2, f"{keys} colours of the evidence are named")
        check(reading(page).get("evidence", "") != "", "the read-out has no evidence")
    pair = page.value("document.querySelectorAll('.pair img').length")
    check(pair == (2 if (folder / "views/novel.png").exists() else 0), f"{pair} pictures of the novel view")


def check_hover(page, folder):
    """The read-out against the files themselves."""
    depth, sigma, prior = (load(folder / f"{name}.npy") for name in ("depth", "sigma", "prior"))
    (rows, columns), _ = depth
    left, top, width, height = page.box("#viewer")
    for u, v in ((0.25, 0.25), (0.7, 0.4), (0.5, 0.8)):
        page.mouse("mouseMoved", left + u * width, top + v * height)
        page.settle()
        said = reading(page)
        outside = page.value("[...document.querySelectorAll('#readout dd')].filter((d) => d.scrollWidth > d.clientWidth).map((d) => d.textContent)")
        check(outside == [], f"the read-out is too narrow for {outside}")
        x, y = map(int, said["pixel"].split(", "))
        check(abs(x - u * columns) <= 3 + columns / 320 and abs(y - v * rows) <= 3 + rows / 320, f"{said} at {u}, {v}")
        if columns > 640 or rows > 640:
            continue  # The page holds a smaller map.
        at = y * columns + x
        for name, (_, values) in (("prior", prior), ("refined", depth)):
            true = values[at]
            shown = said[name].split()
            check((shown == ["missing"]) == (true == 0), f"{name} at {x}, {y}: {said[name]} for {true}")
            if true:
                check(abs(float(shown[0]) - true) < 2e-3 * true, f"{name} at {x}, {y}: {said[name]} for {true}")
        if sigma[1][at] != float("inf") and depth[1][at]:
            shown = said["refined"].split()
            check(shown[1] == "±" and abs(float(shown[2]) - sigma[1][at]) < 1e-2 * sigma[1][at] + 1e-6, f"sigma at {x}, {y}: {said['refined']}")
        check("±" in said["prior"] or said["prior"] == "missing", f"the prior has no sigma: {said['prior']}")


def check_halves(page):
    """With the slider at an end the whole picture is one layer; the ends show different ones."""
    pictures = []
    for value in (0, 1000):
        page.value(f"(() => {{ const s = document.getElementById('split'); s.value = {value}; s.dispatchEvent(new Event('input')); }})()")
        page.settle()
        pictures.append(page.pixels("#viewer"))
    check(pictures[0] != pictures[1], "both ends of the slider look alike")


def load(path):
    """Shape and values of a .npy of little-endian 32-bit floats."""
    import array
    import ast
    raw = path.read_bytes()
    length = int.from_bytes(raw[8:10], "little")
    header = ast.literal_eval(raw[10:10 + length].decode())
    check(header["descr"] == "<f4" and not header["fortran_order"], f"{path}: {header}")
    values = array.array("f", raw[10 + length:])
    if sys.byteorder == "big":
        values.byteswap()
    return header["shape"], values


def check_capture(page):
    """Points, cameras and the surface of a capture turn, zoom and can be filtered; pictures and table fit."""
    loaded = page.value("Promise.all([...document.images].map((i) => { i.loading = 'eager'; return i.decode(); })).then(() => true)")
    check(loaded, "a picture is broken")
    cut = page.value("[...document.images].filter((i) => i.getBoundingClientRect().width > innerWidth).length")
    check(cut == 0, f"{cut} pictures are wider than the window")
    left, top, width, height = page.box("#capture-cloud")
    seen = [page.pixels("#capture-cloud")]

    def changed(what):
        page.settle()
        check(page.pixels("#capture-cloud") != seen[-1], f"{what} does not change the view")
        seen.append(page.pixels("#capture-cloud"))

    middle = (left + 0.5 * width, top + 0.5 * height)
    page.drag(middle, (middle[0] + 60, middle[1] + 5))
    changed("dragging")
    page.value("document.getElementById('capture-cloud').focus()")
    page.key("ArrowLeft")
    changed("an arrow key")
    count = "+document.getElementById('capture-count').textContent.match(/([0-9,]+) of/)[1].replaceAll(',', '')"
    every = page.value(count)

    def choose(which, value):
        page.value(f"(() => {{ const s = [...document.querySelectorAll('#capture select')].at({which}); s.value = '{value}'; s.dispatchEvent(new Event('change')); }})()")

    choose(-1, "2")
    changed("the filter")
    some = page.value(count)
    check(0 < some < every, f"{some} of {every} points are confirmed twice")
    page.value("document.getElementById('capture-cloud').focus()")
    page.key("0")
    changed("0")
    choose(0, "surface")
    changed("the surface")
    check(page.value("/[1-9].* triangles/.test(document.getElementById('capture-count').textContent)"), "the surface has no triangles")


def check_evaluation(page, folder):
    """The table sorts, the figures and thumbnails are there."""
    names = "[...document.querySelectorAll('#scores tbody th')].map((t) => t.textContent)"
    first = page.value(names)
    check(len(first) >= 2, f"the table has the rows {first}")
    for expected in ("ascending", "descending"):
        page.value("document.querySelector('#scores button[data-key=method]').click()")
        check(page.value("document.querySelector('#scores th').ariaSort") == expected, f"the heading does not say {expected}")
        rows = page.value(names)
        # As JavaScript compares: by code units.
        check(rows == sorted(first, reverse=expected == "descending"), f"sorted {expected}: {rows}")
    key = page.value("document.querySelectorAll('#scores button')[1].dataset.key")
    page.value(f"document.querySelector('#scores button[data-key={key}]').click()")
    numbers = page.value("[...document.querySelectorAll('#scores tbody tr')].map((r) => parseFloat(r.cells[1].firstChild.textContent))")
    check(numbers in (sorted(numbers), sorted(numbers, reverse=True)), f"the column {key} is not sorted: {numbers}")
    check("[" in page.value("document.querySelector('#scores tbody').textContent"), "the table has no intervals")
    for view in page.value("[...document.querySelectorAll('select')].map((s) => [s.ariaLabel, [...s.options].map((o) => o.value)])"):
        for option in view[1]:
            page.value(f"(() => {{ const s = document.querySelector('select[aria-label={json.dumps(view[0])}]');"
                       f"s.value = {json.dumps(option)}; s.dispatchEvent(new Event('change')); }})()")
            cells = page.value("document.querySelectorAll('#scores tbody td').length")
            check(cells > 0, f"no scores for {option}")
    check(page.value("document.querySelectorAll('#verdict li').length") >= 1, "there is no verdict")
    if page.value("document.getElementById('worst-first') !== null"):
        order = "[...document.querySelectorAll('#scene-list h3')].map((h) => h.textContent)"
        usual = page.value(order)
        page.value("document.getElementById('worst-first').click()")
        check(sorted(page.value(order)) == sorted(usual), "scenes are lost when they are sorted")
        page.value("document.getElementById('worst-first').click()")
        check(page.value(order) == usual, "the scenes do not come back in their order")
    figures = len(list(folder.glob("*.svg")))
    check(page.value("document.querySelectorAll('.figures img').length") == figures, f"not the folder's {figures} figures")
    loaded = page.value("Promise.all([...document.images].map((i) => i.decode())).then(() =>"
                        "[...document.images].every((i) => i.naturalWidth > 0))")
    check(loaded, "a picture is broken")
    counted = int(page.value("document.querySelector('h1 + p').textContent").split(" · ")[1].split()[0])
    check(counted == len(first), f"{counted} methods are said to be there, and {len(first)} are in the table")
    small = page.value("[...document.querySelectorAll('.figures img')].map((i) => i.getBoundingClientRect().width)")
    check(min(small, default=900) > 400, f"the letters of figures {small} px wide can't be read")
    check(page.value("document.querySelectorAll('.strip img').length") >= 2 or not (folder / "scenes").exists(), "there are no thumbnails")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("pages", nargs="+", type=pathlib.Path)
    parser.add_argument("--shots", type=pathlib.Path, help="a folder for screenshots")
    arguments = parser.parse_args()
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        print(f"skipped: none of {', '.join(NAMES)} is installed")
        return 77
    if arguments.shots:
        arguments.shots.mkdir(parents=True, exist_ok=True)
    failed = 0
    for path in arguments.pages:
        for size in SIZES:
            for scheme in ("light", "dark"):
                failed += not fresh(program, path, size, scheme, arguments.shots)
    return 1 if failed else 0


def fresh(program, path, size, scheme, shots):
    """The same in a browser of its own; a browser that goes silent says nothing of the page, and gets a second chance."""
    for chance in (1, 2):
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            browser = Browser(program, profile)
            try:
                return one(browser, path, size, scheme, shots)
            except Silent as fault:
                print(f"{'again ' if chance == 1 else 'FAILED'}  {path} {size} {scheme}: {fault}")
            finally:
                browser.close()
    return False


def one(browser, path, size, scheme, shots):
    """Whether a page holds all of its promises in one window."""
    page = Page(browser, path, SIZES[size], scheme)
    try:
        check(check_any(page) == (scheme == "light"), f"the page is not {scheme}")
        if page.value("document.getElementById('viewer') !== null"):
            check_run(page, path.parent)
        elif page.value("document.getElementById('capture') !== null"):
            check_capture(page)
        else:
            check_evaluation(page, path.parent)
        text = page.value("document.body.innerText")
        check(not re.search(r"\[object|\bundefined\b|\bNaN\b", text), "the page shows a value of the script's own")
        complaints = page.complaints()
        check(complaints == [], f"the console says {complaints}")
        print(f"ok      {path} {size} {scheme}")
        return True
    except (AssertionError, RuntimeError, TimeoutError) as error:
        print(f"FAILED  {path} {size} {scheme}: {error}")
        print(f"        console: {page.complaints()}")
        return False
    finally:
        if shots:
            page.value("scrollTo(0, 0)")
            page.shot(shots / f"{path.parent.name}-{size}-{scheme}.png")
        page.close()


if __name__ == "__main__":
    sys.exit(main())
