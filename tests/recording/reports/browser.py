"""Opens reports in a headless Chromium as a phone, on a dark screen and as paper.

browser.py CHROMIUM PAGE...: one JSON object on stdout, what was found of each page.
"""

import json
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

FLAGS = "--no-sandbox --disable-gpu --no-first-run --disable-background-networking".split()

# Letters in the figure that is shown, in pixels of the screen: the least of them.
LETTERS = """() => Math.min(...[...document.querySelectorAll("figure svg")].filter((s) => s.getBoundingClientRect().width > 0)
  .flatMap((s) => [...s.querySelectorAll("text")].map((t) => parseFloat(t.getAttribute("font-size"))
    * s.getBoundingClientRect().width / s.viewBox.baseVal.width)))"""

# Contrast of the page's letters on the page, and of a figure's on its paper.
CONTRAST = """() => {
  const light = (c) => {
    const [r, g, b] = c.match(/[0-9.]+/g).slice(0, 3).map((v) => v / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b + 0.05;
  };
  const ratio = (a, b) => Math.max(light(a), light(b)) / Math.min(light(a), light(b));
  const of = (e, name) => getComputedStyle(e)[name];
  const body = document.body, svg = document.querySelector("figure svg");
  return [ratio(of(body, "color"), of(body, "backgroundColor")), ratio(of(svg.querySelector("text"), "fill"), of(svg.querySelector("rect"), "fill"))];
}"""

# Figures that may be broken over two pages of paper.
BROKEN = """() => [...document.querySelectorAll("figure")].filter((f) => getComputedStyle(f).breakInside !== "avoid").length"""


def look(browser, page_file):
    """What is found of one page."""
    found = {"contrast": {}}
    for mode, scheme in [("light", "light"), ("dark", "dark")]:
        page = browser.new_page(viewport={"width": 390, "height": 844}, color_scheme=scheme)
        page.goto(Path(page_file).resolve().as_uri())
        found["contrast"][mode] = page.evaluate(CONTRAST)
        found["phone_scroll_px"] = page.evaluate("document.documentElement.scrollWidth")
        found["phone_letter_px"] = page.evaluate(LETTERS)
        # A reader with a dark screen prints on white paper too.
        page.emulate_media(media="print", color_scheme=scheme)
        found["contrast"]["print"] = page.evaluate(CONTRAST)
        found["print_paper"] = page.evaluate("getComputedStyle(document.body).backgroundColor")
        found["broken_figures"] = page.evaluate(BROKEN)
        page.close()
    return found


with sync_playwright() as playwright:
    chromium = playwright.chromium.launch(executable_path=sys.argv[1], args=FLAGS)
    print(json.dumps({name: look(chromium, name) for name in sys.argv[2:]}))
    chromium.close()
