"""The drawings of the docs: as the script makes them, well-formed, and within their frames."""

from __future__ import annotations

import importlib.util
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType

import pytest

DOCS = Path(__file__).parents[1] / "docs"
NAMES = ("beam", "circuit", "four_probes", "process", "wiring")
SVG = "{http://www.w3.org/2000/svg}"
LETTER = 7.8  # of 14 pixels, on average [pixel]


@pytest.fixture(scope="module")
def drawings() -> ModuleType:
    spec = importlib.util.spec_from_file_location("drawings", DOCS / "drawings.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_a_drawing_is_as_the_script_makes_it_and_stays_within_its_frame(drawings: ModuleType, name: str) -> None:
    path = DOCS / "images" / f"{name}.svg"
    text = path.read_text(encoding="utf-8")
    assert set(drawings.DRAWINGS) == set(NAMES)
    assert text == drawings.DRAWINGS[name]().svg(), "run python docs/drawings.py"
    root = ElementTree.fromstring(text)
    width, height = float(root.attrib["width"]), float(root.attrib["height"])
    for element in root.iter(f"{SVG}text"):
        long = LETTER * len("".join(element.itertext()))
        x, y = float(element.attrib["x"]), float(element.attrib["y"])
        left = x - {"start": 0.0, "middle": 0.5, "end": 1.0}[element.attrib["text-anchor"]] * long
        assert left >= 0.0
        assert left + long <= width
        assert 12.0 <= y <= height - 4.0
    for element in root.iter(f"{SVG}polyline"):
        for point in element.attrib["points"].split():
            x, y = map(float, point.split(","))
            assert 0.0 <= x <= width
            assert 0.0 <= y <= height


def test_every_drawing_is_on_a_page() -> None:
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCS.glob("*.md"))
    assert all(f"(images/{name}.svg)" in pages for name in NAMES)


def test_indices_are_set_low(drawings: ModuleType) -> None:
    low = '<tspan dy="4" font-size="10">dc</tspan>'
    assert drawings.lowered("R_dc") == f"R{low}"
    assert drawings.lowered("R_dc < 1") == f'R{low}<tspan dy="-4"> </tspan>&lt; 1'
