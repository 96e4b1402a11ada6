"""NI's own client. The only module of the laboratory that imports ``nidaqmx``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ipmclab.extras import how_to_install
from ipmclab.rig.bench import BenchError

if TYPE_CHECKING:
    pass


def client() -> Any:
    """NI's own client, the package ``nidaqmx``.

    Raises
    ------
    BenchError
        It is not installed.
    """
    try:
        import nidaqmx
        import nidaqmx.constants
        import nidaqmx.errors
        import nidaqmx.grpc_session_options
        import nidaqmx.stream_readers
        import nidaqmx.stream_writers
        import nidaqmx.system
    except ImportError as error:
        raise BenchError(
            "the package nidaqmx is not installed",
            code="no-nidaqmx",
            where="bench",
            repair=how_to_install("ni"),
        ) from error
    return nidaqmx
