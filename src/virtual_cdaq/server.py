"""The server: NI's service on 127.0.0.1, and the pump that keeps events and levels going."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc

from virtual_cdaq.calls import CALLS, STREAMS
from virtual_cdaq.model.chassis import Chassis
from virtual_cdaq.model.clock import LockStepClock
from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.listening import next_event
from virtual_cdaq.model.waiting import Gone, gate
from virtual_cdaq.protocol import SERVICE, Method, attribute_call, methods
from virtual_cdaq.service import Service
from virtual_cdaq.sessions import Refused

THREADS = 64  # each open event stream and each waiting call holds one
LARGEST_MESSAGE = 256 * 2**20  # bytes; gRPC's own limit of 4 MiB is half a million samples
PUMP = 0.02  # s between two looks at a chassis that runs by itself
CATCH_UP = 0.005  # s that a client gets to take an event in before time continues in lock-step
LONGEST_DROP = 3600.0  # s
LAST_PORT = 65535


class Server:
    """A chassis behind NI's protocol.

    Parameters
    ----------
    chassis : Chassis
    port : int
        On 127.0.0.1; 0 for a free one.

    Raises
    ------
    ValueError
        No such port.

    Attributes
    ----------
    port : int
        The one in use, after `start`.

    Examples
    --------
    >>> from virtual_cdaq.model.plant import RcPlant
    >>> server = Server(Chassis(RcPlant(), LockStepClock()), port=0)
    >>> server.start().startswith("127.0.0.1:")
    True
    >>> server.stop()
    """

    def __init__(self, chassis: Chassis, port: int = 0) -> None:
        if not 0 <= port <= LAST_PORT:
            raise ValueError(f"port {port}: 0 (any free one) to {LAST_PORT}")
        self.chassis = chassis
        self.port = port
        self._service = Service(chassis)
        self._server: Any = None
        self._closed = threading.Event()
        self._pump = threading.Thread(target=self._run_pump, name="virtual_cdaq pump", daemon=True)
        chassis.faults.on_drop = self._drop

    @property
    def address(self) -> str:
        """Where it listens."""
        return f"127.0.0.1:{self.port}"

    def start(self) -> str:
        """Listen.

        Returns
        -------
        str
            The address, ``127.0.0.1:PORT``.

        Raises
        ------
        OSError
            The port is taken.
        """
        self._listen()
        self._pump.start()
        return self.address

    def wait(self) -> None:
        """Serve until `stop`."""
        self._closed.wait()

    def stop(self) -> None:
        """Close; calls that wait are let go."""
        self._closed.set()
        self.chassis.close()
        if self._server is not None:
            self._server.stop(grace=0.2).wait()

    def _listen(self) -> None:
        server = grpc.server(
            ThreadPoolExecutor(THREADS, thread_name_prefix="virtual_cdaq"),
            options=[
                ("grpc.max_receive_message_length", LARGEST_MESSAGE),
                ("grpc.max_send_message_length", LARGEST_MESSAGE),
                ("grpc.so_reuseport", 0),
                # A client that looks for a dead server asks more often than gRPC likes by default.
                ("grpc.http2.min_recv_ping_interval_without_data_ms", 100),
                ("grpc.keepalive_permit_without_calls", 1),
            ],
        )
        handlers = {}
        for method in methods():
            handler = self._handler(method)
            if handler is not None:
                handlers[method.name] = handler
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(SERVICE, handlers),))
        try:
            port = server.add_insecure_port(f"127.0.0.1:{self.port}")
        except RuntimeError as error:
            raise OSError(f"127.0.0.1:{self.port} cannot be listened on: {error}") from error
        if port == 0:
            raise OSError(f"127.0.0.1:{self.port} cannot be listened on")
        self.port = port
        server.start()
        self._server = server

    def _handler(self, method: Method) -> Any:
        if method.name in STREAMS:
            return grpc.unary_stream_rpc_method_handler(
                lambda request, context: self._stream(method, request, context),
                request_deserializer=method.request.FromString,
                response_serializer=method.response.SerializeToString,
            )
        wanted = attribute_call(method.name)
        function = CALLS.get(method.name)
        if function is None and wanted is None:
            return None

        def answer(request: Any) -> Any:
            if wanted is not None:
                return self._service.attribute(wanted, request, method.response)
            assert function is not None
            return function(self._service, request)

        return grpc.unary_unary_rpc_method_handler(
            lambda request, context: self._answer(answer, method, request, context),
            request_deserializer=method.request.FromString,
            response_serializer=_serialize,
        )

    def _answer(self, function: Any, method: Method, request: Any, context: Any) -> Any:
        chassis = self.chassis
        chassis.caller.alive = context.is_active
        try:
            with chassis.lock:
                gate(chassis)
                response = function(request)
                # A chassis that froze meanwhile does not answer either.
                gate(chassis)
            return response
        except ChassisError as error:
            _abort(context, error, method.name)
        except Refused as error:
            context.abort(getattr(grpc.StatusCode, error.status), error.text)
        except Gone:
            context.abort(grpc.StatusCode.UNAVAILABLE, "The server closes.")

    def _stream(self, method: Method, request: Any, context: Any) -> Any:
        chassis = self.chassis
        chassis.caller.alive = context.is_active
        try:
            with chassis.lock:
                gate(chassis)
                stream = STREAMS[method.name](self._service, request)
        except ChassisError as error:
            # The stream must end before its initial metadata, or the client takes it for a registration.
            _abort(context, error, method.name)
            return
        except Gone:
            context.abort(grpc.StatusCode.UNAVAILABLE, "The server closes.")
            return
        context.add_callback(stream.close)
        context.send_initial_metadata(())
        yield from stream

    def _drop(self, duration: float) -> None:
        threading.Thread(target=self._drop_now, args=(min(duration, LONGEST_DROP),), daemon=True).start()

    def _drop_now(self, duration: float) -> None:
        self._server.stop(grace=0).wait()
        if not self._closed.wait(duration):
            self._listen()

    def _run_pump(self) -> None:
        chassis = self.chassis
        while not self._closed.is_set():
            with chassis.lock:
                if chassis.faults.frozen:
                    chassis.faults.thaw()
                    pause = PUMP
                elif isinstance(chassis.clock, LockStepClock):
                    tick = next_event(chassis.tasks)
                    if tick is not None:
                        chassis.clock.step_to(tick)
                        chassis.advance()
                    pause = CATCH_UP if tick is not None else PUMP
                else:
                    chassis.advance()
                    pause = PUMP
            self._closed.wait(pause)


def _serialize(response: Any) -> bytes:
    return response if isinstance(response, bytes) else response.SerializeToString()


def _abort(context: Any, error: ChassisError, name: str) -> None:
    trailing = [("ni-error", str(error.code))]
    if error.done is not None:
        key = "ni-samps-per-chan-written" if name.startswith("Write") else "ni-samps-per-chan-read"
        trailing.append((key, str(error.done)))
    context.set_trailing_metadata(tuple(trailing))
    context.abort(grpc.StatusCode.UNKNOWN, error.text)
