"""``[chamber]`` of a rig file, and the tables of chambers without a driver: read, refused, written."""

from __future__ import annotations

from pathlib import Path

import pytest

from ipmclab.errors import InputError
from ipmclab.rig.chambers.drivers import open_chamber
from ipmclab.rig.chambers.settings import ChamberSettings
from ipmclab.rig.chambers.table_file import RegisterTable, TextTable, read_table
from ipmclab.rig.channels import THESIS_RIG
from ipmclab.rig.files.rig_file import load_rig, rig_from_text
from ipmclab.rig.files.text import rig_to_text
from tests.rig.chambers.devices import MODBUS_TABLE, SCPI_TABLE

BASE = rig_to_text(THESIS_RIG)

ESPEC = 'driver = "espec-p300"\naddress = "192.168.0.10"\ntemperature = ["10 degC", "60 degC"]'


def read(chamber: str) -> ChamberSettings:
    settings = rig_from_text(f"{BASE}\n[chamber]\n{chamber}\n").chamber
    assert settings is not None
    return settings


@pytest.mark.parametrize(
    "chamber",
    [
        'driver = "virtual"',
        ESPEC,
        ESPEC + '\nrelative_humidity = ["20 percent", "95 percent"]\npatience = "2.5 s"',
        'driver = "espec-sh"\nport = "COM3"\ntemperature = ["-10 degC", "60 degC"]\nbaud_rate = 19200\nparity = "even"',
        'driver = "watlow-f4t"\naddress = "f4t:502"\ntemperature = ["0 degC", "60 degC"]\nunit = 2\nrun_event = 1',
        'driver = "dew-point"\nport = "COM4"\ncell_temperature = "25 degC"\nrelative_humidity = ["5 percent", "90 %"]',
        'driver = "scpi"\naddress = "[::1]:5025"\ntable = "chamber.toml"\ntemperature = ["0 degC", "60 degC"]',
    ],
)
def test_a_rig_file_with_a_chamber_is_written_as_it_was_read(chamber: str) -> None:
    rig = rig_from_text(f"{BASE}\n[chamber]\n{chamber}\n")
    assert rig_from_text(rig_to_text(rig)) == rig
    assert rig.chamber is not None


def test_settings_have_what_stands_in_the_file() -> None:
    settings = read(ESPEC + '\nrelative_humidity = ["20 percent", "95 percent"]')
    assert (settings.temperature, settings.relative_humidity) == ((10.0, 60.0), (20.0, 95.0))
    assert (settings.where, settings.waits) == ("192.168.0.10:10001", 3.0)
    assert read(
        'driver = "scpi"\naddress = "[::1]:99"\ntable = "t"\ntemperature = ["0 degC", "60 degC"]'
    ).host_and_port == (
        "::1",
        99,
    )


def test_a_rig_without_a_chamber_is_written_as_before() -> None:
    assert "chamber" not in BASE.partition("[output]")[2]
    assert load_rig("thesis").chamber is None


@pytest.mark.parametrize(
    ("chamber", "where", "code"),
    [
        ('driver = "espec"', "chamber.driver", "bad-value"),
        ('driver = "virtual"\nport = "COM3"', "chamber.port", "needless-key"),
        ('driver = "espec-sh"\ntemperature = ["0 degC", "9 degC"]', "chamber", "missing-key"),
        (ESPEC + '\nport = "COM3"', "chamber", "needless-key"),
        ('driver = "espec-sh"\nport = "COM3"', "chamber.temperature", "missing-key"),
        (ESPEC.replace("60", "5"), "chamber.temperature", "out-of-range"),
        (ESPEC.replace("60", "900"), "chamber.temperature", "out-of-range"),
        (ESPEC.replace("0.10", "0.10:0"), "chamber.address", "bad-value"),
        (ESPEC + '\nrelative_humidity = ["20 degC", "95 percent"]', "chamber.relative_humidity.0", "bad-unit"),
        (ESPEC + '\npatience = "9 s"', "chamber.patience", "out-of-range"),
        (ESPEC + '\ntable = "a.toml"', "chamber.table", "needless-key"),
        (ESPEC + "\nrun_event = 1", "chamber.run_event", "needless-key"),
        (ESPEC.replace("espec-p300", "modbus") + '\ntable = "a.toml"\nunit = 3', "chamber.unit", "needless-key"),
        (ESPEC + "\nbaud_rate = 7", "chamber.baud_rate", "bad-value"),
        (ESPEC + '\nhumidity = "60 percent"', "chamber.humidity", "unknown-key"),
        ('driver = "scpi"\naddress = "a"\ntemperature = ["0 degC", "60 degC"]', "chamber.table", "missing-key"),
        ('driver = "dew-point"\nport = "COM3"', "chamber.cell_temperature", "missing-key"),
        (
            'driver = "dew-point"\nport = "COM3"\ncell_temperature = "25 degC"',
            "chamber.relative_humidity",
            "missing-key",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_its_place(chamber: str, where: str, code: str) -> None:
    with pytest.raises(InputError) as caught:
        read(chamber)
    assert (caught.value.where, caught.value.code) == (f"rig: {where}", code)
    assert caught.value.repair


def test_a_table_lies_beside_its_rig_file(tmp_path: Path) -> None:
    chamber = 'driver = "scpi"\naddress = "127.0.0.1:1"\ntable = "words.toml"\ntemperature = ["0 degC", "60 degC"]'
    (tmp_path / "rig.toml").write_text(f"{BASE}\n[chamber]\n{chamber}\n", encoding="utf-8")
    settings = load_rig(tmp_path / "rig.toml").chamber
    assert settings is not None
    with pytest.raises(InputError) as caught:
        open_chamber(settings)
    assert caught.value.code == "no-chamber-table"
    (tmp_path / "words.toml").write_text(SCPI_TABLE, encoding="utf-8")
    assert open_chamber(settings).ranges.temperature == (0.0, 60.0)


@pytest.mark.parametrize(
    ("change", "where", "code"),
    [
        ((":SOURCE:CLOOP1:SPOINT {value:.2f}", ":SOURCE:CLOOP1:SPOINT 20"), "temperature.tell", "bad-value"),
        ((":SOURCE:CLOOP2:SPOINT {value:.2f}", "{value.real.x}"), "relative_humidity.tell", "bad-value"),
        (("constant =", "running ="), "run.running", "unknown-key"),
        (('celsius = "C"', ""), "unit.celsius", "missing-key"),
        (("[temperature]", "[temperature"), "", "bad-toml"),
    ],
)
def test_a_table_that_says_nothing_of_use_is_refused(
    change: tuple[str, str], where: str, code: str, tmp_path: Path
) -> None:
    path = tmp_path / "chamber.toml"
    path.write_text(SCPI_TABLE.replace(*change), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_table(path, TextTable)
    assert caught.value.code == code
    assert caught.value.where == (f"{path}: {where}" if where else str(path))


def test_registers_are_numbers_that_there_are(tmp_path: Path) -> None:
    path = tmp_path / "chamber.toml"
    path.write_text(MODBUS_TABLE.replace("number = 30", "number = 70000"), encoding="utf-8")
    with pytest.raises(InputError, match=r"alarm\.number"):
        read_table(path, RegisterTable)


@pytest.mark.parametrize(
    ("key", "told"), [("run_event = 9", "9 is above 8; give 8 or less"), ("unit = 248", "248 is above 247; give 247")]
)
def test_a_number_beyond_its_greatest_is_told_that(key: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        read(f"{ESPEC}\n{key}")
