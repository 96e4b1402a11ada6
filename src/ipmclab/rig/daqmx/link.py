"""The connection to a chassis behind a gRPC server, on which no call waits for ever.

The official client sets no deadline: a read with a timeout of 1 s waits for ever when the server hangs, because only
the server looks at that timeout. Here every call has a deadline. Keepalive pings, the other remedy, are left
out: a server with gRPC's default settings answers pings that come more often than every five minutes with
"too many pings" and closes the connection, in the middle of a run (measured: pinged every second, a call that waits
for 12 s is cut off after 5 s).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from ipmclab.extras import how_to_install
from ipmclab.rig.bench import BenchError

if TYPE_CHECKING:
    import grpc

MARGIN: Final = 1.0
"""How much longer [s] than the server's own timeout a call may take."""

PATIENCE: Final = 2.0
"""How long [s] a call without a timeout of its own may take."""

OPENING_PATIENCE: Final = 10.0
"""The same [s] while a bench is opened: a driver reads its configuration at its first call, a reset takes its time."""

_OPTIONS: Final = [
    # Some blocks of many channels at high rates are larger than the 4 MB that gRPC allows by default.
    ("grpc.max_receive_message_length", 64 * 1024 * 1024),
    ("grpc.max_send_message_length", 64 * 1024 * 1024),
    # A server that was restarted is found again at once, not after the usual second and more.
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.min_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 500),
    # Each connection is its own: the guardian's must not be the one that hangs.
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.enable_http_proxy", 0),
]


class Link:
    """A gRPC channel with a deadline on every call.

    Parameters
    ----------
    address : str
        ``host:port``.
    wait : float [s]
        For the server to answer at all.
    patience : float [s]
        How long a call without a timeout of its own may take; may be changed.

    Raises
    ------
    BenchError
        ``"no-grpc"`` without the package, ``"bench-unreachable"`` when no server answers.
    """

    def __init__(self, address: str, *, wait: float, patience: float) -> None:
        try:
            import grpc
        except ImportError as error:
            raise BenchError(
                "the package grpcio is not installed",
                code="no-grpc",
                where=address,
                repair=how_to_install("ni"),
            ) from error
        self.patience = patience
        self._channel = grpc.insecure_channel(address, options=_OPTIONS)
        self.channel: grpc.Channel = grpc.intercept_channel(self._channel, _deadline_interceptor(self))
        try:
            grpc.channel_ready_future(self._channel).result(timeout=wait)
        except grpc.FutureTimeoutError as error:
            self.close()
            raise BenchError(
                f"no gRPC server answers at {address} (waited {wait:g} s)",
                code="bench-unreachable",
                where="address",
                repair="start the server (ni_grpc_device_server, or ipmclab rig serve), check host and port in the rig "
                "file, and look whether a firewall is between; leave `address` out for a chassis at this computer",
            ) from error

    def close(self) -> None:
        """Let go of the connection. Calls that are under way end; may be called twice."""
        self._channel.close()


def _deadline_interceptor(link: Link) -> Any:
    # Made here because the base class lives in grpc, which is only imported when it is used.
    import grpc

    class Details(grpc.ClientCallDetails):  # type: ignore[misc]
        def __init__(self, of: Any, timeout: float) -> None:
            self.method = of.method
            self.timeout = timeout
            self.metadata = of.metadata
            self.credentials = of.credentials
            self.wait_for_ready = None
            self.compression = None

    class Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
        def intercept_unary_unary(self, continuation: Any, details: Any, request: Any) -> Any:
            own = getattr(request, "timeout", None)
            limit = own + MARGIN if own is not None and own >= 0 else link.patience
            return continuation(Details(details, limit), request)

    return Deadline()
