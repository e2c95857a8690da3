"""A web site in headless Chromium: pages that scroll sideways, pictures that do not load, messages of the console."""

import html
import json
import re
import shutil
import subprocess

WIDTHS = (360, 1280)
"""Widths of a telephone and of a screen (CSS pixels)."""

MEASURE = """
<!DOCTYPE html><meta charset="utf-8"><iframe></iframe><pre></pre><script>
const frame = document.querySelector("iframe"), found = [];
const pages = PAGES.flatMap(page => WIDTHS.map(width => [page, width]));
frame.height = 800;
function loaded(source) {
  return new Promise(done => {
    const image = new Image();
    image.onload = () => done(null);
    image.onerror = () => done(source);
    image.src = source;
  });
}
function next() {
  const [page, width] = pages[found.length] || [];
  if (!page) { document.querySelector("pre").textContent = JSON.stringify(found); return; }
  frame.width = width;
  frame.onload = () => {
    const seen = frame.contentDocument, root = seen.documentElement;
    Promise.all([...seen.images].map(image => loaded(image.src))).then(missing => {
      found.push([page, width, root.scrollWidth - root.clientWidth, missing.filter(x => x)]);
      next();
    });
  };
  frame.src = page;
}
next();
</script>
"""


def program():
    """Return the path of Chromium or Chrome; None if there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def seen(folder, scratch):
    """Show all pages of a site; return page, width, pixels too wide and missing pictures of each, and the console."""
    pages = sorted(path.as_uri() for path in folder.rglob("*.html"))
    outer = scratch / "measure.html"
    text = MEASURE.replace("PAGES", json.dumps(pages)).replace("WIDTHS", json.dumps(WIDTHS))
    outer.write_text(text, encoding="utf-8")
    command = [
        program(), "--headless=new", "--no-sandbox", "--disable-gpu", "--allow-file-access-from-files",
        "--enable-logging=stderr", f"--user-data-dir={scratch / 'profile'}", "--virtual-time-budget=600000",
        "--dump-dom", outer.as_uri(),
    ]  # fmt: skip
    answer = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=300, check=True)
    (found,) = re.findall(r"<pre>(.*?)</pre>", answer.stdout, flags=re.S)
    console = [line for line in answer.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(html.unescape(found)), console
