"""What NI's client was refused while a program of NI's ran: the calls and properties that the stand-in has not."""

from __future__ import annotations

from typing import Any

import nidaqmx.errors
from nidaqmx import _grpc_interpreter as client

refused: list[str] = []
"""Names of calls that nobody answers, and messages of errors, since it was last cleared."""


def listen() -> None:
    """Note from now on what the client is refused; the client itself notices nothing."""
    interpreter: Any = client.GrpcStubInterpreter
    invoke = interpreter._invoke

    def noting(self: Any, function: Any, request: Any, *rest: Any, **more: Any) -> Any:
        try:
            return invoke(self, function, request, *rest, **more)
        except nidaqmx.errors.RpcError as error:
            if "UNIMPLEMENTED" in str(error):
                refused.append(f"call {_name(function)}")
            raise
        except nidaqmx.errors.DaqError as error:
            refused.append(f"{error.error_code} {error}")
            raise

    interpreter._invoke = noting


def _name(function: Any) -> str:
    method = getattr(function, "_method", b"?")
    return (method.decode() if isinstance(method, bytes) else str(method)).rpartition("/")[2]
