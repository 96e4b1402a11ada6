"""``[chamber]`` of a rig file: which chamber, where it is, and what it may be set to."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ipmclab.errors import InputError, missing_key
from ipmclab.rig.chambers.settings import MOST_PATIENCE, ChamberSettings
from ipmclab.units import RELATIVE_HUMIDITY, TEMPERATURE, TIME, Quantity, parse_quantity

if TYPE_CHECKING:
    from ipmclab.rig.files.tables import ChamberTable, TextPair

_TEMPERATURES: Final = (-80.0, 200.0)  # [degC]: what chambers reach
_HUMIDITIES: Final = (1.0, 100.0)  # [percent]
_NEEDS: Final = {
    "scpi": ("table", '"chamber.toml"'),
    "modbus": ("table", '"chamber.toml"'),
    "dew-point": ("cell_temperature", '"25 degC"'),
}
"""The key without which a driver can do nothing."""

_ONLY_OF: Final = {
    "table": ("scpi", "modbus"),
    "cell_temperature": ("dew-point",),
    "run_event": ("watlow-f4t",),
}


def chamber_settings(table: ChamberTable, where: str, folder: Path | None) -> ChamberSettings:
    """Read the settings of a chamber.

    Parameters
    ----------
    table : ChamberTable
    where : str
        What the messages name: the file and the table.
    folder : Path, optional
        Where the path of a table starts.

    Raises
    ------
    InputError
        Neither port nor address, both, a range that no chamber has, a key that this driver needs or does not know.
    """
    _check_line(table, where)
    _check_keys(table, where)
    humidity = None
    if table.relative_humidity is not None:
        humidity = _range(table.relative_humidity, RELATIVE_HUMIDITY, _HUMIDITIES, f"{where}.relative_humidity")
    patience = None
    if table.patience is not None:
        patience = parse_quantity(table.patience, TIME, where=f"{where}.patience")
        if not 0.1 <= patience <= MOST_PATIENCE:
            raise InputError(
                f"{patience:g} s is not from 0.1 s to {MOST_PATIENCE:g} s",
                code="out-of-range",
                where=f"{where}.patience",
                repair="give how long the chamber takes for one answer",
            )
    path = table.table
    if path is not None and folder is not None:
        path = str(folder / path)
    return ChamberSettings(
        driver=table.driver,
        temperature=_temperatures(table, where),
        relative_humidity=humidity,
        port=table.port,
        address=table.address,
        baud_rate=table.baud_rate,
        parity=table.parity,
        unit=table.unit,
        patience=patience,
        table=path,
        cell_temperature=None
        if table.cell_temperature is None
        else parse_quantity(table.cell_temperature, TEMPERATURE, where=f"{where}.cell_temperature"),
        run_event=table.run_event,
    )


def chamber_table(settings: ChamberSettings) -> dict[str, Any]:
    """The table from which ``chamber_settings`` reads the same settings.

    Examples
    --------
    >>> chamber_table(ChamberSettings("espec-sh", (10.0, 60.0), (30.0, 95.0), port="COM3"))["relative_humidity"]
    ['30 percent', '95 percent']
    """
    plain = ChamberSettings(settings.driver)
    table: dict[str, Any] = {"driver": settings.driver}
    for key in ("port", "address", "baud_rate", "parity", "unit", "table", "run_event"):
        if getattr(settings, key) != getattr(plain, key):
            table[key] = getattr(settings, key)
    if settings.patience is not None:
        table["patience"] = f"{settings.patience:.15g} s"
    if settings.temperature is not None:
        table["temperature"] = [f"{end:.15g} degC" for end in settings.temperature]
    if settings.relative_humidity is not None:
        table["relative_humidity"] = [f"{end:.15g} percent" for end in settings.relative_humidity]
    if settings.cell_temperature is not None:
        table["cell_temperature"] = f"{settings.cell_temperature:.15g} degC"
    return table


def _check_line(table: ChamberTable, where: str) -> None:
    """A real chamber is at a port or at an address."""
    if table.driver == "virtual":
        for key in ("port", "address"):
            if getattr(table, key) is not None:
                raise InputError(
                    f"a virtual chamber has no {key}",
                    code="needless-key",
                    where=f"{where}.{key}",
                    repair="take it out, or name the driver of the real chamber",
                )
        return
    if (table.port is None) == (table.address is None):
        said = "neither port nor address" if table.port is None else "a port and an address"
        raise InputError(
            f"it has {said}",
            code="missing-key" if table.port is None else "needless-key",
            where=where,
            repair='write port = "COM3" for a serial port, or address = "192.168.0.10"',
        )
    if table.address is not None:
        host, colon, port = table.address.rpartition(":")
        if colon and not (host and port.isascii() and port.isdigit() and 0 < int(port) < 65536):
            raise InputError(
                f"{table.address!r} is neither HOST nor HOST:PORT",
                code="bad-value",
                where=f"{where}.address",
                repair='write for example "192.168.0.10:502"',
            )


def _check_keys(table: ChamberTable, where: str) -> None:
    needed, example = _NEEDS.get(table.driver, ("", ""))
    if needed and getattr(table, needed) is None:
        raise missing_key(f"{where}.{needed}", f"add {needed} = {example}")
    if table.driver == "dew-point" and table.relative_humidity is None:
        raise missing_key(f"{where}.relative_humidity", 'add relative_humidity = ["5 percent", "95 percent"]')
    if table.driver == "modbus" and table.unit != 1:
        raise InputError(
            f"unit is {table.unit} here, and the table of the registers has a unit_id of its own",
            code="needless-key",
            where=f"{where}.unit",
            repair=f"take it out, and write unit_id = {table.unit} in the table",
        )
    for key, drivers in _ONLY_OF.items():
        if getattr(table, key) is not None and table.driver not in drivers:
            raise InputError(
                f"the driver {table.driver} has no {key}",
                code="needless-key",
                where=f"{where}.{key}",
                repair=f"take it out; {' and '.join(drivers)} know it",
            )


def _temperatures(table: ChamberTable, where: str) -> tuple[float, float] | None:
    if table.temperature is not None:
        return _range(table.temperature, TEMPERATURE, _TEMPERATURES, f"{where}.temperature")
    if table.driver in ("virtual", "dew-point"):
        return None
    raise missing_key(
        f"{where}.temperature", 'add temperature = ["10 degC", "60 degC"]: the chamber is never set beyond'
    )


def _range(pair: TextPair, quantity: Quantity, ends: tuple[float, float], where: str) -> tuple[float, float]:
    low, high = (parse_quantity(text, quantity, where=f"{where}.{place}") for place, text in enumerate(pair))
    if not ends[0] <= low < high <= ends[1]:
        raise InputError(
            f"{low:g} to {high:g} {quantity.unit} is no range within {ends[0]:g} to {ends[1]:g} {quantity.unit}",
            code="out-of-range",
            where=where,
            repair="give the least and the greatest value that the chamber may be set to",
        )
    return low, high
