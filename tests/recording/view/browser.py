"""Opens the page of finished logs in a headless Chromium, by keyboard alone; pictures of it go into a folder.

browser.py CHROMIUM URL FOLDER: one JSON object on stdout.
"""

import json
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

FLAGS = """--no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking
--disable-component-update --disable-sync""".split()

SHOWN = """() => {
  const canvas = document.getElementById("picture");
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let stripe = 0;
  for (let i = 0; i < data.length; i += 4) if (data[i] > 150 && data[i + 1] > 130 && data[i + 2] < 120) stripe++;
  const controls = [...document.querySelectorAll("button, select, input")].filter((e) => e.offsetParent);
  const name = (e) => e.getAttribute("aria-label") || (e.labels && e.labels[0] && e.labels[0].textContent.trim()) || e.textContent.trim();
  return {
    stripe: stripe > 100, plots: document.querySelectorAll("#plots .uplot").length,
    scroll_px: document.documentElement.scrollWidth, names: controls.map(name),
  };
}"""

# Times between the page's frames while it plays for so long.
GAPS = """async (ms) => {
  const at = [];
  let on = true;
  const f = (t) => { at.push(t); if (on) requestAnimationFrame(f); };
  requestAnimationFrame(f);
  await new Promise((done) => setTimeout(done, ms));
  on = false;
  return at.slice(1).map((t, k) => t - at[k]);
}"""


def by_keyboard(page, found):
    """What keys do, one after the other; where Tab comes to."""

    def now():
        return float(page.inner_text("#now").replace("−", "-").split(" ")[0])

    found["keys"] = keys = {}
    for key in ["Home", "ArrowRight", "End", "Home", "Shift+ArrowRight"]:
        page.keyboard.press(key)
        page.wait_for_timeout(400)
        keys[key] = now()
    page.keyboard.press("[")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_timeout(300)
    page.keyboard.press("]")
    found["range"] = page.inner_text("#window")
    page.keyboard.press("z")
    page.wait_for_timeout(300)
    page.keyboard.press("0")
    page.keyboard.press("Home")
    page.wait_for_timeout(300)
    page.keyboard.press(" ")
    gaps = sorted(page.evaluate(GAPS, 3000))
    page.keyboard.press(" ")
    keys["Space"] = now()
    found["frame_ms"] = gaps[int(0.95 * (len(gaps) - 1))]
    all_ids = page.evaluate("[...document.querySelectorAll('button, select, input')].filter((e) => e.offsetParent && !e.disabled && e.id).map((e) => e.id)")
    reached = set()
    for _ in range(80):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id"))
    found["unreached"] = [i for i in all_ids if i not in reached]
    with page.expect_download() as download:
        page.focus("#csv")
        page.keyboard.press("Enter")
    found["csv"] = Path(download.value.path()).read_text()[:200]


def main():
    chromium, url, folder = sys.argv[1:]
    found = {"errors": [], "shown": []}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for width, height in [(1440, 1000), (390, 844)]:
            for scheme in ["light", "dark"]:
                context = browser.new_context(viewport={"width": width, "height": height}, color_scheme=scheme)
                page = context.new_page()
                page.on("console", lambda m: found["errors"].append(m.text) if m.type in ("error", "warning") else None)
                page.on("pageerror", lambda e: found["errors"].append(str(e)))
                page.goto(url)
                page.wait_for_timeout(2500)
                page.screenshot(path=f"{folder}/view-{width}-{scheme}.png", full_page=True)
                found["shown"].append({"width_px": width, "scheme": scheme, **page.evaluate(SHOWN)})
                if (width, scheme) == (1440, "light"):
                    by_keyboard(page, found)
                context.close()
        browser.close()
    print(json.dumps(found))


main()
