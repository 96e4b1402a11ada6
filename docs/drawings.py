"""The drawings of the docs: ``python docs/drawings.py`` writes them to ``docs/images/``.

Lengths are in pixels; ``_`` in a text sets the letters after it, up to a blank or a comma, low.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal
from xml.sax.saxutils import escape

IMAGES: Final = Path(__file__).parent / "images"
INK, MUTED, ACCENT, PALE = "#1b1f24", "#6b7680", "#0072b2", "#e8f1f8"
SIZE: Final = 14
Anchor = Literal["start", "middle", "end"]
Point = tuple[float, float]


@dataclass
class Drawing:
    """What is drawn, as SVG elements.

    Parameters
    ----------
    width, height : float
    title : str
        For those who cannot see it.
    """

    width: float
    height: float
    title: str
    parts: list[str] = field(default_factory=list)

    def line(
        self, *points: Point, colour: str = INK, dashed: bool = False, arrow: str = "", width: float = 1.6
    ) -> None:
        """A line through points; ``arrow`` is ``"end"`` or ``"both"``."""
        look = ' stroke-dasharray="5 4"' if dashed else ""
        look += f' marker-end="url(#{"accent" if colour == ACCENT else "ink"})"' if arrow else ""
        look += f' marker-start="url(#{"accent" if colour == ACCENT else "ink"})"' if arrow == "both" else ""
        path = " ".join(f"{x:g},{y:g}" for x, y in points)
        self.parts.append(f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{look}/>')

    def text(
        self, x: float, y: float, words: str, anchor: Anchor = "middle", *, colour: str = INK, bold: bool = False
    ) -> None:
        """A line of text, its foot at y."""
        look = ' font-weight="bold"' if bold else ""
        self.parts.append(
            f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" fill="{colour}"{look}>{lowered(words)}</text>'
        )

    def box(self, x: float, y: float, width: float, height: float, *words: str, ours: bool = False) -> None:
        """A box with lines of text, the first one bold; dashed where the thesis does not have it."""
        look = ' stroke-dasharray="5 4"' if ours else ""
        fill = "#ffffff" if ours else PALE
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="4" fill="{fill}" '
            f'stroke="{INK}" stroke-width="1.3"{look}/>'
        )
        top = y + height / 2 - (len(words) - 1) * 9 + 5
        for place, one in enumerate(words):
            self.text(x + width / 2, top + 18 * place, one, bold=place == 0, colour=INK if place == 0 else MUTED)

    def rectangle(self, x: float, y: float, width: float, height: float, fill: str) -> None:
        """A filled area."""
        self.parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" fill="{fill}" '
            f'stroke="{INK}" stroke-width="1.3"/>'
        )

    def dot(self, x: float, y: float) -> None:
        """A joint of wires."""
        self.parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="3.2" fill="{INK}"/>')

    def resistor(self, x: float, y: float, words: str, *, upright: bool = True) -> None:
        """A resistor about a point, 44 long."""
        width, height = (16, 44) if upright else (44, 16)
        self.rectangle(x - width / 2, y - height / 2, width, height, "#ffffff")
        if upright:
            self.text(x + 16, y + 5, words, "start")
        else:
            self.text(x, y - 15, words)

    def capacitor(self, x: float, y: float, words: str) -> None:
        """An upright capacitor about a point, 10 long."""
        self.parts.append(f'<rect x="{x - 3:g}" y="{y - 5:g}" width="6" height="10" fill="#ffffff"/>')
        self.line((x - 15, y - 5), (x + 15, y - 5), width=2.4)
        self.line((x - 15, y + 5), (x + 15, y + 5), width=2.4)
        self.text(x + 22, y + 5, words, "start")

    def span(self, start: Point, end: Point, words: str, *, beside: float = -7) -> None:
        """A dimension between two points."""
        self.line(start, end, colour=ACCENT, arrow="both", width=1.2)
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        if start[0] == end[0]:
            self.text(middle[0] + abs(beside), middle[1] + 5, words, "start", colour=ACCENT)
        else:
            self.text(middle[0], middle[1] + beside, words, colour=ACCENT)

    def svg(self) -> str:
        """The file."""
        heads = "".join(
            f'<marker id="{name}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="7" markerHeight="7" '
            f'orient="auto-start-reverse"><path d="M0 0L10 5L0 10z" fill="{colour}"/></marker>'
            for name, colour in (("ink", INK), ("accent", ACCENT))
        )
        body = "\n".join(self.parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width:g}" height="{self.height:g}" '
            f'viewBox="0 0 {self.width:g} {self.height:g}" role="img" font-family="sans-serif" font-size="{SIZE}">\n'
            f"<title>{escape(self.title)}</title>\n<defs>{heads}</defs>\n"
            f'<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
        )


def lowered(words: str) -> str:
    """A text with its indices set low: ``R_dc`` and ``(L_f + L_c)``."""
    out, low = "", False
    for letter in words:
        if letter == "_":
            out += '<tspan dy="4" font-size="10">'
            low = True
        elif low and not letter.isalnum():
            out += f'</tspan><tspan dy="-4">{escape(letter)}</tspan>'
            low = False
        else:
            out += escape(letter)
    return out + ("</tspan>" if low else "")


def circuit() -> Drawing:
    """The equivalent circuit (Friend, section 4.2), with the contact resistance that is ours."""
    one = Drawing(
        680, 330, "Equivalent circuit: source, contact, electrode, and behind them R_dc and two branches, electrode"
    )
    top, foot = 70.0, 260.0
    one.line((70, 165), (70, top), (590, top))
    one.line((70, 165), (70, foot), (590, foot))
    one.parts.append(f'<circle cx="70" cy="165" r="24" fill="#ffffff" stroke="{INK}" stroke-width="1.6"/>')
    one.text(70, 170, "V_in")
    one.resistor(150, top, "R_contact", upright=False)
    one.resistor(245, top, "R_e", upright=False)
    one.resistor(245, foot, "R_e", upright=False)
    one.line((85, 95), (125, 95), colour=ACCENT, arrow="end")
    one.text(105, 113, "I_in", colour=ACCENT)
    for x, number in ((360, 0), (460, 1), (590, 2)):
        one.line((x, top), (x, foot))
        if number < 2:
            one.dot(x, top)
            one.dot(x, foot)
        if number == 0:
            one.resistor(x, 165, "R_dc")
            continue
        one.resistor(x, 125, f"R_C{number}")
        one.capacitor(x, 205, f"C_{number}")
    one.line((310, top + 12), (310, foot - 12), colour=ACCENT, arrow="both", width=1.2)
    one.text(302, 170, "V_appl", "end", colour=ACCENT)
    one.text(460, 295, "fast", colour=MUTED)
    one.text(590, 295, "slow", colour=MUTED)
    one.text(245, 295, "the other electrode", colour=MUTED)
    return one


def beam() -> Drawing:
    """The clamped strip with its dimensions (Friend, section 4.2)."""
    one = Drawing(
        680, 330, "Clamped strip: clamped length, free length, sensing length, width, thickness, displacement, force"
    )
    y, left, clamp, sensing, end = 150.0, 90.0, 190.0, 510.0, 590.0
    one.rectangle(left - 30, y - 52, clamp - left + 30, 44, "#c9d1d8")
    one.rectangle(left - 30, y + 8, clamp - left + 30, 44, "#c9d1d8")
    one.text(125, y - 25, "contact")
    one.text(125, y + 36, "contact")
    one.rectangle(left, y - 8, end - left, 16, PALE)
    one.line((left, y - 8), (end, y - 8), width=3)
    one.line((left, y + 8), (end, y + 8), width=3)
    one.parts.append(
        f'<path d="M{clamp:g} {y:g}C330 {y:g} 470 {y - 30:g} {end - 8:g} {y - 92:g}" fill="none" stroke="{MUTED}" '
        'stroke-width="1.6" stroke-dasharray="5 4"/>'
    )
    one.line((sensing, y + 12), (sensing, y + 78), colour=MUTED, dashed=True, width=1)
    one.line((sensing, y - 12), (sensing, y - 59), colour=ACCENT, arrow="end")
    one.text(sensing + 12, y - 24, "δ or f", "start", colour=ACCENT)
    one.span((left, y + 105), (clamp, y + 105), "L_c")
    one.span((clamp, y + 105), (end, y + 105), "L_f")
    one.span((clamp, y + 70), (sensing, y + 70), "L_s")
    one.span((left, y + 145), (end, y + 145), "L_t = L_f + L_c")
    one.span((end + 16, y - 9), (end + 16, y + 9), "h")
    one.text(340, 40, "width w: into the picture", colour=MUTED)
    for x in (left, clamp, end):
        one.line((x, y + 58), (x, y + 150), colour=MUTED, width=0.8)
    return one


def wiring() -> Drawing:
    """What is wired to what (Friend, section 3.2); dashed boxes are ours."""
    one = Drawing(900, 520, "Wiring of the rig: chassis, amplifier, shunt, clamp, laser, load cell, four probes")
    one.box(20, 190, 120, 70, "computer", "USB")
    one.box(200, 60, 150, 60, "NI 9263", "output ±10 V")
    one.box(200, 150, 150, 190, "NI 9205", "inputs")
    one.box(200, 370, 150, 60, "NI 9217", "1 mA, four wires")
    one.text(275, 45, "cDAQ-9174", bold=True)
    one.parts.append(
        f'<rect x="188" y="25" width="174" height="420" rx="6" fill="none" stroke="{MUTED}" stroke-width="1.2"/>'
    )
    one.line((140, 225), (188, 225), arrow="both")
    one.box(420, 60, 150, 60, "current amplifier", "300 mA")
    one.box(620, 60, 90, 60, "shunt", "1 ohm")
    one.box(760, 60, 120, 60, "clamp", "strip")
    one.line((350, 90), (420, 90), arrow="end")
    one.line((570, 90), (620, 90), arrow="end")
    one.line((710, 90), (760, 90), arrow="end")
    one.line((665, 120), (665, 175), (350, 175), arrow="end")
    one.text(510, 169, "ai0: current, 1 V for 1 A", colour=MUTED)
    one.line((820, 120), (820, 205), (350, 205), arrow="end")
    one.text(510, 199, "ai3: voltage", colour=MUTED)
    one.box(660, 225, 220, 50, "laser optoNCDT 1420-25", "4 to 20 mA")
    one.box(420, 225, 90, 50, "500 ohm", "2 to 10 V")
    one.line((660, 250), (510, 250), arrow="end")
    one.line((420, 250), (350, 250), arrow="end")
    one.text(385, 243, "ai1", colour=MUTED)
    one.box(740, 295, 140, 50, "load cell", "GSO-10")
    one.box(420, 295, 150, 50, "LCA-RTC", "10 V for 10 gf")
    one.line((740, 320), (570, 320), arrow="end")
    one.line((420, 320), (350, 320), arrow="end")
    one.text(385, 313, "ai2", colour=MUTED)
    one.box(420, 372, 150, 56, "four probes", "on the strip")
    one.line((420, 400), (350, 400), arrow="both")
    one.box(610, 372, 130, 56, "humidity", "ai4, ours", ours=True)
    one.box(755, 372, 125, 56, "Pt100", "NI 9217, ours", ours=True)
    one.box(420, 460, 150, 44, "RS-485 to USB")
    one.line((880, 250), (890, 250), (890, 482), (570, 482), arrow="both", dashed=True)
    one.line((420, 482), (80, 482), (80, 260), arrow="both", dashed=True)
    one.text(250, 475, "settings of the laser", colour=MUTED)
    one.text(545, 28, "24 V supply: laser, LCA-RTC", colour=MUTED)
    return one


def probes() -> Drawing:
    """Four contacts across the strip (Friend, section 3.2)."""
    one = Drawing(680, 300, "Four probes: current through the outer contacts, voltage between the inner ones")
    one.rectangle(70, 130, 540, 70, PALE)
    for x in (130, 240, 440, 550):
        one.rectangle(x - 4, 122, 8, 86, "#b87333")
    one.line((130, 122), (130, 50), (300, 50))
    one.line((380, 50), (550, 50), (550, 122))
    one.parts.append(f'<circle cx="340" cy="50" r="24" fill="#ffffff" stroke="{INK}" stroke-width="1.6"/>')
    one.line((300, 50), (316, 50))
    one.line((364, 50), (380, 50))
    one.text(340, 55, "1 mA")
    one.line((240, 122), (240, 96), (320, 96))
    one.line((360, 96), (440, 96), (440, 122))
    one.parts.append(f'<circle cx="340" cy="100" r="20" fill="#ffffff" stroke="{INK}" stroke-width="1.6"/>')
    one.text(340, 105, "V")
    one.span((240, 232), (440, 232), "spacing d", beside=20)
    one.span((626, 131), (626, 199), "w")
    one.text(340, 282, "R_s = (V/I) w/d : contacts reach across the whole width", colour=MUTED)
    return one


def process() -> Drawing:
    """The order in which the parameters are found (Friend, section 4.5)."""
    one = Drawing(760, 330, "Process: sheet resistance, dc resistance, branches, density, modulus, coupling")
    steps = (
        ("1  sheet resistance", "four probes", "R_e, eq. 4.1"),
        ("2  dc resistance", "steady current at 1 V", "ρ_dc, eq. 4.2"),
        ("3  branches", "current of step and sine", "ρ_1, ε_1, ρ_2, ε_2"),
        ("4  density", "mass and volume", "ρ_m"),
        ("5  modulus", "push with the load cell", "Y, eq. 4.11"),
        ("6  coupling", "force of step and sine", "K_d, Z_d, P_1d, P_2d"),
    )
    for place, words in enumerate(steps):
        row, column = divmod(place, 3)
        x, y = 20 + 250 * column, 50 + 150 * row
        one.box(x, y, 220, 90, *words)
        if column < 2:
            one.line((x + 220, y + 45), (x + 250, y + 45), arrow="end")
    one.line((630, 140), (630, 170), (130, 170), (130, 200), arrow="end")
    one.text(20, 35, "electrical", "start", bold=True, colour=ACCENT)
    one.text(150, 192, "mechanical", "start", bold=True, colour=ACCENT)
    one.text(
        380,
        318,
        "then: a square and the displacement, which no step has seen, validate the model (section 5.2)",
        colour=MUTED,
    )
    return one


DRAWINGS: Final[dict[str, Callable[[], Drawing]]] = {
    "circuit": circuit,
    "beam": beam,
    "wiring": wiring,
    "four_probes": probes,
    "process": process,
}


def main() -> None:
    """Write every drawing."""
    for name, make in DRAWINGS.items():
        (IMAGES / f"{name}.svg").write_text(make().svg(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
