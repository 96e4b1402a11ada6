"""Sound commands of every verb with the files that they read, and how they are spoiled: words, lines, bytes."""

from __future__ import annotations

import datetime
import gzip
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import nptdms
import numpy as np
import openpyxl
import scipy.io
from hypothesis import strategies as st

import ipmclab
from ipmclab.procedure.template import TEMPLATE as PROCEDURE
from ipmclab.rig.experiments.experiment_file import TEMPLATE as EXPERIMENT
from ipmclab.run import RunMetadata
from ipmclab.sample import Sample
from ipmclab.store.journal.journal import Journal, JournalHeader
from ipmclab.sweep.template import TEMPLATE as SWEEP

ROWS: Final = 60
PERIOD: Final = 0.02  # s

MAP: Final = """[file]
format = "{format}"
{layout}
[channels.time]
column = "time"
unit = "s"
[channels.voltage]
column = "voltage"
unit = "V"
[channels.current]
column = "current"
unit = "mA"
[metadata]
mounting_id = "a"
shunt_resistance = "1 ohm"
"""

LVM: Final = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t.
Multi_Headings\tNo
X_Columns\tNo
***End_of_Header***\t
\t
Channels\t2\t
Samples\t60\t60
Y_Unit_Label\tVolts\tmA
X_Dimension\tTime\tTime
X0\t0.0E+0\t0.0E+0
Delta_X\t0.020000\t0.020000
***End_of_Header***\t\t
X_Value\tvoltage\tcurrent\tComment
"""

CAMPAIGN: Final = """title = "two voltages"
seed = 1
order = "randomised"
measure = ["mass"]
[method]
rate = "50 Hz"
duration = "2 s"
rest_before = "1 s"
limits = { voltage = "4 V" }
[[samples]]
id = "friend-2"
actuator = "strip.toml"
[[experiments]]
name = "displacement"
measured = ["current", "displacement"]
signals = ["step 1 V", "sine 1 V 2 Hz"]
environments = ["20 degC, 80 percent"]
repeats = 2
baseline = true
"""

COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    "simulate": (
        "simulate strip.toml --signal 'step 1 V' --duration '1 s' --rate '50 Hz' --out out.nc",
        "simulate friend-2 --signal 'sine 1 V 2 Hz phase=9 deg' --duration 1s --rate 50Hz --out out.nc --hold zero",
        "simulate fitted.toml --signal 'file signal.csv' --duration '1 s' --rate '50 Hz' --out out.nc",
    ),
    "import": (
        "import record.csv --map map.toml --out out.nc",
        "import record.csv.gz --map map.toml --out out.nc",
        "import record.xlsx --map xlsx.toml --out out.nc",
        "import record.mat --map mat.toml --out out.nc",
        "import record.tdms --map tdms.toml --out out.nc",
        "import record.lvm --map lvm.toml --out out.nc",
        "import record.bin --map binary.toml --out out.nc",
        "import english.csv --out out.nc",
        "import german.csv --out out.nc --answer channels.current.unit=mA",
        "import record.xlsx --template new.toml",
    ),
    "export": (
        "export step.nc --out out.csv",
        "export step.nc --out out.mat",
        "export step.nc --out out.xlsx",
        "export fitted.toml --to matlab --out strip.m",
        "export kept --to ro-crate --out crate.zip --title Steps --person 'Ada Example <0000-0002-1825-0097>'",
    ),
    "check": ("check step.nc sine.nc --actuator strip.toml --fail-on error", "check strip.toml step.nc"),
    "plot": ("plot step.nc --out out.svg",),
    "identify": (
        "identify strip.toml step.nc --free electrical --out out.toml --per-run circuit.contact_resistance",
        "identify fitted.toml step.nc sine.nc --free coupling,circuit.dc_resistivity --out o.toml --prior "
        "circuit.dc_resistivity",
    ),
    "profile": ("profile strip.toml step.nc --free circuit.dc_resistivity",),
    "bootstrap": ("bootstrap fitted.toml step.nc --free circuit.dc_resistivity --count 40",),
    "posterior": (
        "posterior strip.toml step.nc --free circuit.dc_resistivity --out out.nc --figure pairs.svg --steps 100",
    ),
    "procedure": ("procedure procedure.toml --out out.toml", "procedure procedure.toml"),
    "validate": ("validate fitted.toml step.nc --also strip.toml", "validate strip.toml sine.nc"),
    "forecast": ("forecast fitted.toml long.nc --origin '15 s' --horizon '3 s' --channel displacement --level 0.8",),
    "choose": ("choose step.nc sine.nc --models branches=1,2 --actuator strip.toml --free electrical --out out.toml",),
    "report": ("report fitted.toml --runs step.nc --validation sine.nc --out out.html",),
    "record": (
        "record experiment.toml --plan",
        "record experiment.toml --yes --answers answers.toml --repeats 2 --pair",
        "record experiment.toml --plan --answer clamp=done",
    ),
    "recover": ("recover laboratory",),
    "runs": (
        "runs . --signal step --amplitude '0.9 V..1.1 V' --since 2026-11-21",
        "runs . --finding spike --measured current --until 2026-11-23 --state complete",
    ),
    "page": ("page . --no-open --port 0 --host 127.0.0.1 --token-file token.txt",),
    "demo": ("demo --out results",),
    "rig": (
        "rig check rig.toml --actuator strip.toml --amplitude '1 V'",
        "rig prove rig.toml --yes --operator me",
        "rig sheet rig.toml --width '5 mm' --count 3",
        "rig serve rig.toml --port 0 --clock x10 --fault 'freeze at 2 s' --levels levels.json",
    ),
    "identifiability": (
        "identifiability strip.toml --free electrical,coupling.gain --outputs current --voltage '2 V'",
    ),
    "baseline": ("baseline rest.nc --displacement '1.3 mm' --test '1 s' --share 0.1",),
    "smooth": ("smooth step.nc --below '5 Hz' --out out.nc",),
    "compare": (
        "compare step.nc sine.nc long.nc --by voltage,thickness --metric displacement.largest --strip strip.toml",
        "compare step.nc sine.nc --out out.html --posterior",
        "compare fitted.toml other.toml --posterior",
    ),
    "next": (
        "next fitted.toml --minutes 3 --longest '10 s' --rest '5 s' --limit 'current=200 mA' --rate '50 Hz'",
        "next fitted.toml --goal prediction --input 'sine 1 V 1 Hz for 5 s' --minutes 2 --longest '5 s' --rest '5 s' "
        "--draws 2",
        "next campaign.toml --fit fitted.toml --minutes 40 --longest '10 s' --append --yes",
    ),
    "sweep": (
        "sweep sweep.toml --out swept --plot out.svg",
        "sweep table.toml --out swept --workers 2",
        "sweep --template --out new.toml",
    ),
    "characterise": (
        "characterise campaign.toml --plan",
        "characterise campaign.toml --out chapter --yes --answer clamp=done",
    ),
}

_ODD: Final = (
    "nan", "inf", "-inf", "-1", "0", "-0.0", "1e400", "1e-400", "1,5", "1e30", "1e-30", "99999999999999999999", "0x10",
    "1_000", "١٢", "½", "", " ", "true", "[]", "{}", "null", "''", "1 V", "1 mm", "5 Hz", "-5 s", "1 kV", "1 s s",
    "3 m/V/s", "1e3 ohm m", "--", "-", "--json", "--force", "--nowhere", "=", "a=b", "..", ".", "/", "/dev/null", "~",
    "*", "missing.nc", "missing/out.nc", "CON", "a\x00b", "\ud800", "ä" * 300, "\n", "\x1b[31m", "%s", "{0}", "step.nc",
    "strip.toml", "map.toml", "record.csv", "laboratory", "friend-2", "friend-2+leak.cubic", "friend-2+", "electrical",
    "coupling,beam", "circuit.branches.7.resistivity", "observation.delay[0]", "sine 1 V", "step 1 V for 2 s then",
    "2026-13-45",
)  # fmt: skip
ODD_WORDS: Final = st.one_of(
    st.sampled_from(_ODD),
    st.text(max_size=12),
    st.floats().map(str),
    st.integers(-(10**9), 10**9).map(str),
    st.builds(
        lambda n, u: f"{n} {u}",
        st.floats(-1e6, 1e6).map(lambda n: f"{n:.4g}"),
        st.sampled_from(("s", "ms", "V", "mV", "Hz", "kHz", "mm", "ohm", "deg")),
    ),
)


def make_files(folder: Path) -> dict[str, bytes]:
    """Every file that the commands name, sound."""
    strip = replace(ipmclab.load_actuator("friend-2"), sample=Sample(id="friend-2"))
    about = RunMetadata(sample=strip.sample)
    ipmclab.write_actuator(strip, folder / "strip.toml")
    generator = np.random.default_rng(20261121)
    for name, signal, rows in (
        ("step", "step 1 V delay=0.2 s", ROWS),
        ("sine", "sine 1 V 2 Hz", ROWS),
        ("long", "step 1 V delay=0.2 s", 1000),
        ("rest", "step 0 V", ROWS),
    ):
        run = ipmclab.simulate(strip, signal, duration=rows * PERIOD, rate=1.0 / PERIOD)
        noisy = {
            channel: run.channels[channel] + scale * generator.standard_normal(rows)
            for channel, scale in (("current", 1e-4), ("displacement", 2e-6))
        }
        noisy_run = ipmclab.Run.from_arrays(time=run.time, voltage=run.voltage, metadata=about, **noisy)
        ipmclab.write_run(noisy_run, folder / f"{name}.nc")
    step = ipmclab.read_run(folder / "step.nc")
    fit = ipmclab.identify(strip, step, free="circuit.dc_resistivity")
    ipmclab.write_fit(fit, folder / "fitted.toml")
    (folder / "kept").mkdir()
    ipmclab.write_run(step, folder / "kept" / "step.nc")
    other = replace(strip, sample=Sample(id="friend-3"))
    ipmclab.write_fit(ipmclab.identify(other, step, free="circuit.dc_resistivity"), folder / "other.toml")
    columns = {"time": step.time, "voltage": step.voltage, "current": 1e3 * step.channels["current"]}
    table = [list(row) for row in zip(*columns.values(), strict=True)]
    text = ",".join(columns) + "\n" + "".join(",".join(f"{value:.6g}" for value in row) + "\n" for row in table)
    (folder / "record.csv").write_text(text, encoding="utf-8")
    (folder / "record.csv.gz").write_bytes(gzip.compress(text.encode(), mtime=0))
    (folder / "english.csv").write_text(
        "time [s],voltage [V],current [mA]\n" + text.partition("\n")[2], encoding="utf-8"
    )
    german = "Zeit [s];Spannung [V];Strom\n" + text.partition("\n")[2].replace(",", ";").replace(".", ",")
    (folder / "german.csv").write_bytes(german.encode("cp1252"))
    (folder / "signal.csv").write_text("time [s],voltage [V]\n0,0\n0.5,1\n1,0\n", encoding="utf-8")
    _write_tables(folder, columns, table)
    for name in ("csv", "xlsx", "mat", "tdms", "lvm"):
        layout = MAP.format(format=name, layout="")
        if name == "tdms":
            layout = re.sub(r'column = "', 'column = "record/', layout)
        if name == "lvm":
            layout = re.sub(r"\[channels.time\]\n.*\n.*\n", "", layout)
        (folder / ("map.toml" if name == "csv" else f"{name}.toml")).write_text(layout, encoding="utf-8")
    binary = MAP.format(format="binary", layout='columns = ["time", "voltage", "current"]')
    (folder / "binary.toml").write_text(binary, encoding="utf-8")
    (folder / "experiment.toml").write_text(EXPERIMENT, encoding="utf-8")
    (folder / "answers.toml").write_text('clamp = "done"\n', encoding="utf-8")
    (folder / "token.txt").write_text("0123456789abcdef0123456789abcdef\n", encoding="utf-8")
    (folder / "procedure.toml").write_text(
        re.sub(r"^# (?=\[dc|runs = \[\"step.nc\"\]|\[density|mass =)", "", PROCEDURE, flags=re.MULTILINE),
        encoding="utf-8",
    )
    library = Path(ipmclab.__file__).parent / "rig" / "files" / "library" / "thesis.toml"
    (folder / "rig.toml").write_bytes(library.read_bytes())
    (folder / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    sweep = SWEEP.replace('"friend-2"', '"strip.toml"').replace('"10 s"', '"1 s"').replace("512", "8")
    (folder / "sweep.toml").write_text(sweep, encoding="utf-8")
    of_a_table = re.sub(r"\n\[design\].*?\n# In place", "\n# In place", sweep, flags=re.DOTALL)
    (folder / "table.toml").write_text(of_a_table.replace("# table = ", "table = "), encoding="utf-8")
    (folder / "strips.csv").write_text("beam.modulus [GPa],coupling.gain\n1.2,6e-9\n0.9,7e-9\n", encoding="utf-8")
    _write_journal(folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _write_tables(folder: Path, columns: Mapping[str, Any], rows: list[list[Any]]) -> None:
    book = openpyxl.Workbook()
    assert book.active is not None
    for row in ([*columns], *([float(value) for value in row] for row in rows)):
        book.active.append(row)
    book.save(folder / "record.xlsx")
    scipy.io.savemat(folder / "record.mat", dict(columns))
    channels = [nptdms.ChannelObject("record", name, np.asarray(values)) for name, values in columns.items()]
    with nptdms.TdmsWriter(str(folder / "record.tdms")) as writer:
        writer.write_segment([nptdms.RootObject({"made": datetime.datetime(2026, 11, 21)}), *channels])
    lines = "".join(f"\t{row[1]:.6g}\t{row[2]:.6g}\n" for row in rows)
    (folder / "record.lvm").write_text(LVM + lines, encoding="utf-8")
    np.asarray(rows, "<f8").tofile(folder / "record.bin")


def _write_journal(folder: Path) -> None:
    (folder / "laboratory").mkdir()
    uuid = "3f2a77c1-0d4b-4a52-8f0e-2f3a51c0ffee"
    header = JournalHeader(uuid, 50.0, ("voltage", "current"), metadata=RunMetadata(signal="step 1 V"))
    journal = Journal.create(folder / "laboratory", header, ballast=0)
    journal.append(0, np.column_stack([np.ones(ROWS), np.linspace(0.05, 0.01, ROWS)]))
    journal.close()


def spoiled_words(words: list[str], draw: Callable[[Any], Any]) -> list[str]:
    """A command in which one word is another, is gone, comes twice, or has a new one before it."""
    if len(words) < 2:
        return [*words, draw(ODD_WORDS)]
    place = int(draw(st.integers(1, len(words) - 1)))
    match draw(st.sampled_from(("other", "other", "other", "edited", "gone", "twice", "new"))):
        case "other":
            return [*words[:place], draw(ODD_WORDS), *words[place + 1 :]]
        case "edited":
            return [*words[:place], edited(words[place], draw), *words[place + 1 :]]
        case "gone":
            return [*words[:place], *words[place + 1 :]]
        case "twice":
            return [*words[:place], words[place], *words[place:]]
    return [*words[:place], draw(ODD_WORDS), *words[place:]]


def edited(text: str, draw: Callable[[Any], Any]) -> str:
    """A text in which one number or word is another, or a letter is gone or new."""
    tokens = list(re.finditer(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?|\w+|\S", text))
    if not tokens:
        return str(draw(ODD_WORDS))
    found = tokens[int(draw(st.integers(0, len(tokens) - 1)))]
    return f"{text[: found.start()]}{draw(ODD_WORDS)}{text[found.end() :]}"


def spoiled_file(content: bytes, others: Mapping[str, bytes], draw: Callable[[Any], Any]) -> bytes:
    """The content of a file in which bytes, a number, a word or a line is another, or which is another file."""
    how = draw(st.sampled_from(("token", "token", "token", "line", "line", "bytes", "cut", "other", "empty")))
    if how in ("token", "line"):
        try:
            text = content.decode()
        except UnicodeDecodeError:
            how = "bytes"
        else:
            new = edited(text, draw) if how == "token" else _other_line(text, draw)
            return new.encode("utf-8", errors="surrogatepass")
    if how == "bytes" and content:
        changed = bytearray(content)
        for _ in range(draw(st.sampled_from((1, 1, 4, 64)))):
            changed[int(draw(st.integers(0, len(content) - 1)))] ^= 1 << int(draw(st.integers(0, 7)))
        return bytes(changed)
    if how == "cut":
        return content[: int(draw(st.integers(0, len(content))))]
    if how == "other":
        return others[draw(st.sampled_from(sorted(others)))]
    return b""


def _other_line(text: str, draw: Callable[[Any], Any]) -> str:
    lines = text.splitlines(keepends=True) or ["\n"]
    place = int(draw(st.integers(0, len(lines) - 1)))
    match draw(st.sampled_from(("gone", "twice", "moved", "new"))):
        case "gone":
            del lines[place]
        case "twice":
            lines.insert(place, lines[place])
        case "moved":
            lines.insert(int(draw(st.integers(0, len(lines) - 1))), lines.pop(place))
        case _:
            lines.insert(place, f"{draw(ODD_WORDS)}{draw(st.sampled_from((' = ', ',', ' ')))}{draw(ODD_WORDS)}\n")
    return "".join(lines)


def words_of(command: str) -> list[str]:
    """The words of a command, as a shell gives them."""
    return shlex.split(command)
