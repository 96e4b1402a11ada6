"""Which chamber a rig has, as its file says it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

Driver = Literal["virtual", "espec-p300", "espec-sh", "watlow-f4t", "dew-point", "scpi", "modbus"]
"""The languages that chambers are spoken to in; an SCP-220 speaks that of a P300."""

DRIVERS: Final = get_args(Driver)

VIRTUAL: Final = "virtual"
"""The driver of the chamber that exists only as a model."""

BAUD_RATES: Final = {"espec-p300": 19200, "espec-sh": 9600, "watlow-f4t": 38400, "dew-point": 2400}
"""As these leave the factory; for others a table says it."""

PORTS: Final = {
    "espec-p300": 10001,
    "espec-sh": 10001,
    "watlow-f4t": 502,
    "dew-point": 10001,
    "scpi": 5025,
    "modbus": 502,
}
"""Of an address that names none."""

PATIENCE: Final = {"espec-sh": 5.0}
OTHERS_PATIENCE: Final = 3.0
"""How long one answer may take [s]."""

MOST_PATIENCE: Final = 6.0


@dataclass(frozen=True)
class ChamberSettings:
    """``[chamber]`` of a rig file.

    Parameters
    ----------
    driver : Driver
    temperature : (float, float) [degC], optional
        Least and greatest: it is never set beyond. A virtual chamber needs none.
    relative_humidity : (float, float) [percent], optional
        Likewise; None where it regulates no humidity.
    port : str, optional
        A serial port, such as ``"COM3"``.
    address : str, optional
        ``HOST`` or ``HOST:PORT``. A virtual chamber has neither.
    baud_rate : int, optional
        That of ``BAUD_RATES`` where it is left out.
    parity : "none", "even" or "odd"
    unit : int
        The number of a Modbus device on its line.
    patience : float [s], optional
        How long one answer may take.
    table : str, optional
        The path of the table that drivers ``scpi`` and ``modbus`` need.
    cell_temperature : float [degC], optional
        What the cell behind a dew-point generator is kept at.
    run_event : int, optional
        Of a Watlow F4T: the event output that lets the chamber run.
    """

    driver: Driver
    temperature: tuple[float, float] | None = None
    relative_humidity: tuple[float, float] | None = None
    port: str | None = None
    address: str | None = None
    baud_rate: int | None = None
    parity: Literal["none", "even", "odd"] = "none"
    unit: int = 1
    patience: float | None = None
    table: str | None = None
    cell_temperature: float | None = None
    run_event: int | None = None

    @property
    def is_virtual(self) -> bool:
        """Whether it exists only as a model."""
        return self.driver == VIRTUAL

    @property
    def waits(self) -> float:
        """How long one answer may take [s].

        Examples
        --------
        >>> ChamberSettings("espec-sh", (-20.0, 100.0), port="COM3").waits
        5.0
        """
        return PATIENCE.get(self.driver, OTHERS_PATIENCE) if self.patience is None else self.patience

    @property
    def where(self) -> str:
        """Where it is, for people.

        Examples
        --------
        >>> ChamberSettings("watlow-f4t", (-20.0, 100.0), address="192.168.0.10").where
        '192.168.0.10:502'
        """
        if self.port is not None:
            return self.port
        return "this program" if self.address is None else "{}:{}".format(*self.host_and_port)

    @property
    def host_and_port(self) -> tuple[str, int]:
        """The address as ``socket`` takes it."""
        assert self.address is not None
        host, colon, port = self.address.rpartition(":")
        if not colon:
            return self.address, PORTS.get(self.driver, 0)
        return host.strip("[]"), int(port)
