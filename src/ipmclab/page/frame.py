"""The frame of every page: navigation, the bench with STOP and ZERO, theme, and the banner of a lost link."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import Final

from nicegui import ui

SECTIONS: Final = {
    "run": "Run",
    "runs": "Runs",
    "identify": "Identify",
    "simulate": "Simulate",
    "report": "Report",
}
"""The sections, and what they are called."""

HEAD: Final = """
<script>
// What a browser keeps may be full, or not allowed: everything else works without.
function recall(store, name) {
  try { return window[store].getItem(name); } catch { return null; }
}
function remember(store, name, value) {
  try { value === null ? window[store].removeItem(name) : window[store].setItem(name, value); } catch {}
}
document.documentElement.lang = "en";
document.documentElement.dataset.theme = recall("localStorage", "lab-theme")
  ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
</script>
<link rel="stylesheet" href="/vendor/uPlot.min.css">
<link rel="stylesheet" href="/static/lab.css">
<script defer src="/vendor/uPlot.iife.js"></script>
<script defer src="/static/figure.js"></script>
<script defer src="/static/plot.js"></script>
<script defer src="/static/link.js"></script>
"""

_HEADER: Final = """
<a class="lab-skip" href="#app">To the content</a>
<header class="lab-header">
  <h1 class="lab-hidden">{title}</h1>
  <span class="lab-brand">ipmclab</span>
  <nav aria-label="Sections"><ul>{links}</ul></nav>
  <div class="lab-bench" id="lab-bench" data-bench="idle" role="group" aria-label="Bench">
    <span class="lab-lamp" aria-hidden="true"></span>
    <span class="lab-bench-state" role="status"><b id="lab-bench-word">…</b></span>
    <span id="lab-bench-text"></span>
    <span class="lab-guard" id="lab-guard"></span>
  </div>
  <div class="lab-act">
    <button type="button" id="lab-theme" aria-label="Dark colours" aria-pressed="false" title="Light or dark">◐</button>
    <button type="button" id="lab-stop" accesskey="s" disabled>STOP</button>
    <button type="button" id="lab-zero" accesskey="0" title="Emergency: the output to 0 V now">ZERO</button>
  </div>
</header>
<div class="lab-under">
  <div id="lab-lost" role="alert" hidden><span></span></div>
  <span id="lab-said" role="alert"></span>
</div>
"""


_BARE: Final = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title} · ipmclab</title>
<meta name="viewport" content="width=device-width, initial-scale=1">{head}</head><body>{header}
<main id="app" tabindex="-1" class="lab-bare"><section class="lab-card" role="alert"><h2>{title}</h2>{words}
<p><a href="/run">Go to Run</a>, or to a section above.</p></section></main></body></html>"""

# On a tablet too a list opens below its field: Quasar's other way is a dialog without a name, over STOP and ZERO.
ui.select.default_props("behavior=menu")


def frame(section: str) -> None:
    """Put the frame around the section that is being built."""
    ui.page_title(f"{SECTIONS[section]} · ipmclab")
    ui.add_head_html(HEAD)
    ui.add_body_html(_header(SECTIONS[section], section))
    ui.query(".nicegui-content").classes("lab-content")


def bare(title: str, lines: Sequence[str]) -> str:
    """A page with words alone, for where a section cannot be shown: STOP and ZERO work on it too."""
    words = "".join(f"<p>{html.escape(one)}</p>" for one in lines)
    return _BARE.format(head=HEAD, header=_header(title), title=html.escape(title), words=words)


def _header(title: str, section: str = "") -> str:
    links = "".join(
        f'<li><a href="/{name}"{" aria-current=page" if name == section else ""}>{html.escape(text)}</a></li>'
        for name, text in SECTIONS.items()
    )
    return _HEADER.format(links=links, title=html.escape(title))
