"""Parts that several sections are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement

from ipmclab.page.commands import Step
from ipmclab.page.elements.time_plot import Band

if TYPE_CHECKING:
    from nicegui.elements.mixins.validation_element import ValidationElement

    from ipmclab.errors import IpmclabError

_ORDER: Final = {"error": 0, "warning": 1, "info": 2}


@contextmanager
def card(title: str, *, level: int = 2, place: str = "") -> Iterator[ui.element]:
    """A card with a heading; ``place`` is what a link on the page calls it."""
    with ui.element("section").classes("lab-card").props(f"id=lab-{place}" if place else "") as made:
        text(title, tag=f"h{level}")
        yield made


def text(words: str, *, tag: str = "p") -> TextElement:
    """Words in an element of their own, such as a heading, as screen readers know it."""
    return TextElement(tag=tag, text=words)


def fail_at(field: ValidationElement[Any], error: IpmclabError | str | None) -> None:
    """Show at a field what is wrong with it, or nothing."""
    if field.validation is None:
        field.validation = {}  # without any, an error that was shown would stay
    field.error = error if error is None or isinstance(error, str) else sentence(error)


def sentence(error: IpmclabError) -> str:
    """What is wrong and what to do, without the place: the field is the place."""
    return f"{error.message}; {error.repair}" if error.repair else error.message


def step_view() -> Callable[[Step], None]:
    """A place for a command and its Python; gives what fills it, until when it says so."""
    empty = text("Shown here once something is chosen.").classes("lab-quiet")
    note = text("").classes("lab-quiet")
    note.set_visibility(False)
    with ui.element("div").classes("lab-steps"):
        command = _code("In a terminal, in the folder of this page")
        python = _code("In Python")

    def fill(step: Step) -> None:
        empty.set_visibility(False)
        note.set_visibility(bool(step.note))
        note.set_text(step.note)
        command(step.command)
        python(step.python)

    return fill


def _code(title: str) -> Callable[[str], None]:
    with ui.element("div").classes("lab-code") as box:
        with ui.element("div").classes("lab-title"):
            text(title, tag="h3")
            copy = ui.element("button").props(f'type=button aria-label="Copy: {title}"')
            with copy:
                text("Copy", tag="span")
        content = text("", tag="pre").props(f'tabindex=0 role=region aria-label="{title}"')
        box.set_visibility(False)
        copy.on("click", js_handler=f"() => navigator.clipboard.writeText(getHtmlElement({content.id}).innerText)")

    def fill(message: str) -> None:
        box.set_visibility(bool(message))
        content.set_text(message.rstrip())

    return fill


def finding_list(findings: Sequence[Mapping[str, Any]]) -> None:
    """Findings in words, the gravest first."""
    if not findings:
        text("No findings.").classes("lab-quiet")
        return
    with ui.element("ul").classes("lab-findings"):
        for one in sorted(findings, key=lambda finding: _ORDER[finding["severity"]]):
            with ui.element("li").classes(f"lab-{one['severity']}"):
                where = f"{one['model']}, " if one.get("model") else ""
                text(f"{one['severity']}: {where}{one['message']}", tag="span")
                if one["repair"]:
                    text(one["repair"]).classes("lab-quiet")


def finding_bands(findings: Sequence[Mapping[str, Any]]) -> list[Band]:
    """Where findings are on a plot against time, each on the panel of its channel."""
    return [
        Band(begin, end, f"{one['severity']}: {one['code']}", one["severity"], one["channel"])
        for one in findings
        for begin, end in one["times"]
    ]


def plain_table(headings: Mapping[str, str], rows: Sequence[Mapping[str, Any]], *, caption: str) -> None:
    """A small table of texts that nobody sorts: key of each column and its heading."""
    scroll = ui.element("div").classes("lab-scroll").props(f'tabindex=0 role=region aria-label="{caption}"')
    with scroll, ui.element("table").classes("lab-table"):
        with ui.element("thead"), ui.element("tr"):
            for heading in headings.values():
                text(heading, tag="th" if heading else "td").props("scope=col" if heading else "")
        with ui.element("tbody"):
            for row in rows:
                with ui.element("tr"):
                    for key in headings:
                        text(str(row.get(key, "")), tag="td")


def download(label: str, address: str) -> None:
    """A link that saves a file."""
    with ui.element("a").props(f'href="{address}" download').classes("lab-download"):
        text(label, tag="span")
