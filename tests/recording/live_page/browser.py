"""Opens the live page in a headless Chromium, tries it from another site, and presses STOP.

browser.py CHROMIUM URL: one JSON object on stdout. Times are CLOCK_MONOTONIC, as the recording's are.
"""

import http.server
import json
import sys
import threading
import time

from playwright.sync_api import sync_playwright

FLAGS = """--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync""".split()

# What is on the page, found by looking at it: grey pixels, the stripe's colour, digits.
SHOWN = """() => {
  const canvas = document.getElementById("picture");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let grey = 0, stripe = 0;
  for (let i = 0; i < data.length; i += 4) {
    const [r, g, b] = [data[i], data[i + 1], data[i + 2]];
    if (r > 0 && r === g && g === b) grey++;
    if (r > 200 && g > 190 && b < 110) stripe++;
  }
  const digits = (selector) => [...document.querySelectorAll(selector)].some((e) => /[0-9]/.test(e.textContent));
  return { image: grey > 1000, stripe: stripe > 100, pose: digits("#pose td"), loads: digits("#loads .number") };
}"""

EVIL = """<!doctype html><title>elsewhere</title><script>
const target = "%s";
(async () => {
  const read = [];
  for (const path of ["state", "picture", "metrics", ""]) {
    try { await (await fetch(target + path)).text(); read.push(path); } catch (e) {}
  }
  for (const options of [{}, { mode: "no-cors" }, { headers: { "X-Hydroline-Session": "guess" } }])
    try { await fetch(target + "stop", { method: "POST", ...options }); } catch (e) {}
  await new Promise((done) => { const i = new Image(); i.onload = () => { read.push("as an image"); done(); }; i.onerror = done; i.src = target + "picture"; });
  await new Promise((done) => { const f = document.createElement("iframe"); f.onload = () => {
    try { if (f.contentDocument && f.contentDocument.querySelector("meta[name=session]")) read.push("in a frame"); } catch (e) {} done(); };
    f.src = target; document.body.append(f); });
  window.read = read;
})();
</script>"""


def elsewhere(target):
    """A site on another port of this computer."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write((EVIL % target).encode())

        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_address[1]}/"


def wait_for(page, condition, seconds=20):
    """Asks again and again: the page's policy lets nothing be evaluated that a wait of Playwright's would put in."""
    until = time.monotonic() + seconds
    while not page.evaluate(condition):
        if time.monotonic() > until:
            raise TimeoutError(condition)
        page.wait_for_timeout(20)


def main():
    chromium, url = sys.argv[1:]
    found = {"errors": [], "shown_s": {}}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.on("pageerror", lambda error: found["errors"].append(str(error)))
        page.on("console", lambda m: m.type == "error" and found["errors"].append(m.text))
        began = time.monotonic()
        page.goto(url, wait_until="commit")
        while time.monotonic() - began < 30 and len(found["shown_s"]) < 4:
            for what, there in page.evaluate(SHOWN).items():
                if there:
                    found["shown_s"].setdefault(what, round(time.monotonic() - began, 3))
            page.wait_for_timeout(20)
        other = browser.new_page()
        other.goto(elsewhere(url))
        wait_for(other, "window.read !== undefined")
        found["other_site_read"] = other.evaluate("window.read")
        other.close()
        # A page behind another one is hardly drawn.
        page.bring_to_front()
        # The plan has to push before STOP can mean anything.
        wait_for(page, "[...document.querySelectorAll('#loads .number')].some((e) => parseFloat(e.textContent) > 1)")
        found["before"] = page.inner_text("#stop")
        # When the page has the click: what the driver of the browser takes before is its own affair.
        page.evaluate(
            """document.getElementById("stop").addEventListener("click",
            () => { window.pressed_ms = performance.timeOrigin + performance.now(); }, { capture: true })"""
        )
        page.click("#stop")
        to_monotonic_ns = time.monotonic_ns() - time.time_ns()
        found["pressed_ns"] = int(page.evaluate("window.pressed_ms") * 1e6) + to_monotonic_ns
        wait_for(page, "document.getElementById('stop').textContent.startsWith('STOPPED')")
        page.wait_for_timeout(500)
        found["after"] = page.inner_text("#stop")
        browser.close()
    print(json.dumps(found))


main()
