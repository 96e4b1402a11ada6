"""The report as a reader, a browser and an attacker see it."""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html.parser import HTMLParser

import numpy as np
import pytest

from ipmclab import Sample, identify, load_actuator, report, simulate, validate
from ipmclab.errors import InputError
from ipmclab.fit.known import Known
from ipmclab.model.quantities import AT_ONCE
from ipmclab.prediction.fitted import fitted_outputs
from ipmclab.quality import Metric, measure
from ipmclab.reporting.tables import known_rows, metric_rows
from ipmclab.reporting.wording import percent

VOID = {"meta", "link", "br", "img", "input", "hr"}


class Page(HTMLParser):
    """What a page is made of; fails on tags that do not nest."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] != "style":
            self.text += data

    def attributes(self, name: str) -> list[str]:
        return [value for _, attrs in self.tags if (value := attrs.get(name)) is not None]


@pytest.fixture(scope="module")
def text(material, tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    softer = replace(material.fit.actuator, name="softer", fit_table=None).replace(**{"coupling.gain": 5e-9})
    report(
        material.fit,
        runs=material.runs,
        validation_runs=material.validation_runs,
        also=[softer],
        path=path,
        command="ipmclab report <fitted>.toml",
    )
    return path.read_text("utf-8")


@pytest.fixture(scope="module")
def page(text) -> Page:
    return Page(text)


def test_it_stands_alone(text, page) -> None:
    assert len(text) < 2_000_000
    assert not {tag for tag, _ in page.tags} & {"script", "link", "img", "iframe", "object", "base"}
    for name in ("src", "href", "xlink:href", "action", "data"):
        assert all(value.startswith("#") for value in page.attributes(name))
    addresses = re.findall(r"https?://[^\s\"'<)]+", text)
    assert set(addresses) <= {"http://www.w3.org/1999/xlink"}
    assert "@import" not in text
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", text))


def test_ids_are_unique_and_every_reference_has_its_target(text, page) -> None:
    ids = page.attributes("id")
    assert len(ids) == len(set(ids))
    references = {value[1:] for name in ("href", "xlink:href") for value in page.attributes(name)}
    references |= set(re.findall(r"url\(#([^)]*)\)", text)) | set(page.attributes("aria-labelledby"))
    assert references <= set(ids)


def test_hostile_names_stay_text(text, page) -> None:
    assert "<script" not in text
    assert '<script>alert("x")</script> & co' in page.text
    assert "ipmclab report <fitted>.toml" in page.text


def test_everything_that_was_found_is_there(material, page) -> None:
    fit = material.fit
    for name in fit.actuator.parameters():
        assert name in page.text
    for wanted in (
        *(finding.message for finding in fit.findings),
        *(direction.sentence for direction in fit.undetermined),
        *(observation.content_sha256 for observation in fit.observations),
        *(run.content_sha256 for run in material.validation_runs),
        *(metric.definition for run in material.runs for metric in measure(run)),
        "Nafion N117",
        "mounting-7",
        "numpy",
        "softer",
        fit.message,
    ):
        assert wanted in page.text, wanted


def test_the_verdict_comes_first_and_in_words(page) -> None:
    verdict = page.text[: page.text.index("How this was made")]
    assert "the model predicts 1 run that was not given to its fit: current with a fit of" in verdict
    assert "2 of 4 free parameters are not determined by these runs: coupling.gain and coupling.zero." in verdict


def test_an_undetermined_parameter_has_no_number(text) -> None:
    row = next(row for row in text.split("<tr>") if "<code>coupling.gain</code>" in row)
    assert "not determined" in row
    assert "any positive value" in row
    assert "±" not in row
    determined = next(row for row in text.split("<tr>") if "<code>circuit.dc_resistivity</code>" in row)
    assert "43.42 ± 0.43" in determined


def test_a_value_reads_as_lying_in_its_interval(material) -> None:
    known = (Known(AT_ONCE, 16.5701, (16.567, 16.5726)), Known(AT_ONCE, 86.41, (78.9, 91.6)))
    rows = known_rows(replace(material.fit, known=known))
    assert [(row.value, row.interval) for row in rows] == [
        ("16.5701", "16.56700 to 16.57260"),
        ("86.4", "78.9 to 91.6"),
    ]
    (row,) = metric_rows([Metric("largest", "displacement", 6.2076e-3, "m", (6.207495e-3, 6.207771e-3), "")])
    assert (row.value, row.interval) == ("6.20760", "6.207495 to 6.207771")


def test_it_can_be_read_without_eyes(page) -> None:
    tags = [tag for tag, _ in page.tags]
    assert tags.count("h1") == 1
    assert tags.count("caption") == tags.count("table")
    figures = [attrs for tag, attrs in page.tags if tag == "svg"]
    assert len(figures) >= 5
    assert all(attrs["role"] == "img" and attrs["aria-labelledby"] for attrs in figures)
    assert next(attrs for tag, attrs in page.tags if tag == "html")["lang"] == "en"


def test_figures_follow_the_colours_of_the_page(text) -> None:
    body = text[text.index("<body") :]
    assert not re.findall(r"(?:fill|stroke): #(?!fff)[0-9a-f]{6}", body)
    used = set(re.findall(r"var\(--([a-z]+)\)", body))
    defined = set(re.findall(r"^\s+--([a-z]+):", text, flags=re.MULTILINE))
    assert used <= defined
    assert "prefers-color-scheme: dark" in text


def test_doubts_are_said(material, tmp_path) -> None:
    fit = replace(material.fit, converged=False, message="the limit of evaluations was reached")
    path = report(fit, runs=material.runs, path=tmp_path / "report.html")
    told = Page(path.read_text("utf-8")).text
    assert "The identification did not converge: the limit of evaluations was reached." in told
    assert "No run was kept for validation" in told


def test_a_prediction_worse_than_a_constant_is_called_a_failure(material, tmp_path) -> None:
    opposite = [replace(run, displacement=-run.displacement) for run in material.validation_runs]
    path = report(material.fit, runs=material.runs, validation_runs=opposite, path=tmp_path / "report.html")
    told = Page(path.read_text("utf-8")).text
    assert re.search(r"not given to its fit: current with a fit of \d\d\.\d+\s%\.", told)
    assert re.search(
        r"It does not predict the displacement of square 1 V \S+ Hz \(−\d+\.\d\s%\): a constant would have been nearer",
        told,
    )
    assert (
        "This fit can be used to predict the current and force" in told
    )  # the displacement was not among its readings


def test_a_run_of_the_fit_is_no_prediction(material, tmp_path) -> None:
    path = report(material.fit, runs=material.runs, validation_runs=material.runs[:1], path=tmp_path / "report.html")
    told = Page(path.read_text("utf-8")).text
    assert "not given to its fit" not in told
    assert "runs that were not used" not in told
    assert "step 1 V was used to identify the actuator" in told


def test_findings_of_every_model_are_told(material, tmp_path) -> None:
    open_one = replace(material.fit.actuator, name="softer", fit_table={"parameters": [{"name": "beam.modulus"}]})
    path = report(
        material.fit,
        runs=material.runs,
        validation_runs=material.validation_runs,
        also=[open_one],
        path=tmp_path / "report.html",
    )
    told = Page(path.read_text("utf-8")).text
    assert "Prediction of runs that were not used" in told
    assert "the fit of softer did not identify the coupling" in told


def test_the_verdict_scores_only_what_the_model_never_saw(material, tmp_path) -> None:
    fresh = material.validation_runs[0]
    noisy = replace(fresh, current=fresh.current + np.random.default_rng(20261121).normal(0.0, 2e-2, len(fresh)))
    runs = [material.runs[0], noisy]
    path = report(material.fit, runs=material.runs, validation_runs=runs, path=tmp_path / "report.html")
    alone = validate(material.fit.actuator, [noisy]).scores["current"].fit_percent
    together = validate(material.fit.actuator, runs).scores["current"].fit_percent
    assert percent(together) != percent(alone)
    assert (
        f"1 run that was not given to its fit: current with a fit of {percent(alone)}"
        in Page(path.read_text("utf-8")).text
    )


def test_a_fit_that_is_not_to_be_used_says_so_once(material, tmp_path) -> None:
    thin = load_actuator("friend-2").replace(**{"circuit.sheet_resistance": 3.0})
    fit = identify(thin, material.runs, free="electrical")
    path = report(fit, runs=material.runs, validation_runs=material.validation_runs, path=tmp_path / "report.html")
    assert Page(path.read_text("utf-8")).text.count("Do not use this fit") == 1


def test_a_validation_that_shows_nothing_is_a_doubt(material, tmp_path) -> None:
    determined = {name: replace(one, determined=True) for name, one in material.fit.parameters.items()}
    fit = replace(material.fit, parameters=determined)
    silent = replace(material.validation_runs[0], current=np.zeros(600), displacement=None)
    for name, runs, words in (
        ("silent", [silent], "Nothing could be scored in 1 run that was not given to its fit"),
        ("used", material.runs[:1], "those scores show the fit"),
        ("fresh", material.validation_runs, "not given to its fit"),
    ):
        page = Page(
            report(fit, runs=material.runs, validation_runs=runs, path=tmp_path / f"{name}.html").read_text("utf-8")
        )
        assert words in page.text
        assert ("verdict doubt" in page.attributes("class")) == (name != "fresh")


def test_a_motion_that_no_fit_identified_is_not_drawn(tmp_path) -> None:
    """The coupling of the file is that of another strip: beside readings of this one it says nothing."""
    strip = load_actuator("friend-2")
    run, later = (simulate(strip, signal, duration=20.0, rate=50.0) for signal in ("step 1 V", "square 1 V 0.1 Hz"))
    for free in ("electrical", "electrical,coupling"):
        fit = identify(strip, run, free=free)
        path = report(fit, runs=[run], validation_runs=[later], path=tmp_path / f"{len(free)}.html")
        said = (
            "Not drawn: displacement and force, which the fit did not identify." in Page(path.read_text("utf-8")).text
        )
        assert said == (free == "electrical")


def test_nothing_is_overwritten_without_leave(material, tmp_path) -> None:
    path = tmp_path / "report.html"
    path.write_text("precious")
    with pytest.raises(InputError, match="exists"):
        report(material.fit, runs=material.runs, path=path)
    assert path.read_text() == "precious"
    report(material.fit, runs=material.runs, path=path, overwrite=True)
    assert path.read_text("utf-8").startswith("<!DOCTYPE html>")
    assert list(tmp_path.iterdir()) == [path]


def test_other_runs_and_other_suffixes_are_refused(material, tmp_path) -> None:
    path = tmp_path / "report.html"
    with pytest.raises(InputError, match=r"run 0 is not step 1 V, from which the fit was made"):
        report(material.fit, runs=material.runs[::-1], path=path)
    with pytest.raises(InputError, match=r"1 runs given, 2 made the fit; give step 1 V and sine 1 V 0.5 Hz"):
        report(material.fit, runs=material.runs[:1], path=path)
    with pytest.raises(InputError, match=r"cannot be written as '.docx'; write for example report.html"):
        report(material.fit, runs=material.runs, path=tmp_path / "report.docx")
    assert not path.exists()


def test_fitted_values_are_those_that_the_fit_left_its_residuals_from() -> None:
    actuator = load_actuator("friend-2")
    rng = np.random.default_rng(20261121)
    run = simulate(actuator, "square 1 V 0.25 Hz delay=0.5 s", duration=12.0, rate=50.0)
    run = replace(run, current=run.current + rng.normal(0, 1e-4, len(run)), applied_voltage=None, hold="unknown")
    fit = identify(actuator, [run], free="electrical")
    one = fitted_outputs(fit, run, 0)["current"]
    residual = fit.residuals[0]["current"]
    both = one.used & np.isfinite(residual)
    assert np.count_nonzero(both) > 550
    assert np.allclose(one.error[both], residual[both], rtol=0, atol=1e-9)


def test_micrographs_of_the_sample_come_along(material, tmp_path, monkeypatch) -> None:
    """A PNG of one point, made by hand; what is not there, or not below the folder, is named and not read."""
    content = bytes.fromhex(
        "89504e470d0a1a0a0000000d4948445200000001000000010806000000"
        "1f15c4890000000d49444154789c6360606060000000050001a5f645400000000049454e44ae426082"
    )
    monkeypatch.chdir(tmp_path)
    (tmp_path / "surface.png").write_bytes(content)
    (tmp_path.parent / "secret.png").write_bytes(content)
    names = ("surface.png", "gone.png", "../secret.png", str(tmp_path / "surface.png"), "notes.txt", "<b>.png")
    sample = Sample(id="a", soak_time=86400.0, electrode_thickness=8e-6, micrographs=names)
    fit = replace(material.fit, actuator=replace(material.fit.actuator, sample=sample))
    report(fit, runs=material.runs, path=tmp_path / "report.html")
    page = Page((tmp_path / "report.html").read_text("utf-8"))
    pictures = [attrs["src"] for tag, attrs in page.tags if tag == "img"]
    assert pictures == [f"data:image/png;base64,{b64encode(content).decode()}"]
    assert f"Micrograph surface.png: SHA-256 {sha256(content).hexdigest()}" in page.text
    assert page.text.count("the file is not here") == 2
    assert page.text.count("only pictures below the folder of the program are shown") == 2
    assert "soak time" in page.text
