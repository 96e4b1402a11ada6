"""The buffers between the chassis and the program: a ring of samples read, a ring of samples to come."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from virtual_cdaq.model.errors import ChassisError

Codes = NDArray[np.int32]

LARGEST = 2**28  # samples in one buffer (1 GiB): beyond, the driver would be out of memory too


def default_input_size(rate: float) -> int:
    """Samples per channel of the buffer of a continuous acquisition (NI-DAQmx's table).

    Examples
    --------
    >>> default_input_size(50.0), default_input_size(60000.0)
    (1000, 100000)
    """
    if rate <= 100.0:
        return 1_000
    if rate <= 10_000.0:
        return 10_000
    if rate <= 1_000_000.0:
        return 100_000
    return 1_000_000


def _storage(channels: int, size: int) -> Codes:
    if channels * size > LARGEST:
        raise ChassisError(-50352, f"Samples: {channels} channels x {size}\nAllowed: {LARGEST} in all")
    return np.zeros((channels, size), dtype=np.int32)


class InputBuffer:
    """A ring of the samples that were acquired and wait to be read.

    Parameters
    ----------
    channels : int
    size : int
        Samples per channel.

    Attributes
    ----------
    acquired : int
        Samples per channel since the start.
    position : int
        The next sample to be read.
    """

    def __init__(self, channels: int, size: int) -> None:
        self._ring = _storage(channels, size)
        self.size = size
        self.acquired = 0
        self.position = 0

    @property
    def available(self) -> int:
        """Samples per channel that wait."""
        return self.acquired - self.position

    @property
    def overwritten(self) -> bool:
        """Whether samples were lost before they were read."""
        return self.available > self.size

    def skip_lost(self) -> None:
        """Continue with the oldest sample that is still there."""
        self.position = max(self.position, self.acquired - self.size)

    def put(self, codes: Codes) -> None:
        """Add samples, shape (channels, n); the oldest are overwritten."""
        count = codes.shape[1]
        kept = min(count, self.size)
        begin = (self.acquired + count - kept) % self.size
        first = min(kept, self.size - begin)
        tail = codes[:, count - kept :]
        self._ring[:, begin : begin + first] = tail[:, :first]
        self._ring[:, : kept - first] = tail[:, first:]
        self.acquired += count

    def take(self, count: int) -> Codes:
        """The next `count` samples, shape (channels, count)."""
        if self.overwritten:
            lost = self.available - self.size
            raise ChassisError(-200279, f"Samples lost: {lost} per channel\nBuffer: {self.size} samples", done=0)
        begin = self.position % self.size
        first = min(count, self.size - begin)
        taken = np.concatenate((self._ring[:, begin : begin + first], self._ring[:, : count - first]), axis=1)
        self.position += count
        return taken


class OutputBuffer:
    """A ring of the samples that were written and wait to be generated.

    Parameters
    ----------
    channels : int
    size : int
        Samples per channel.

    Attributes
    ----------
    written, generated : int
        Samples per channel since the first write, and since the start.
    """

    def __init__(self, channels: int, size: int) -> None:
        self._ring = _storage(channels, size)
        self.size = size
        self.written = 0
        self.generated = 0

    @property
    def filled(self) -> int:
        """Samples per channel that the ring holds."""
        return min(self.written, self.size)

    @property
    def space(self) -> int:
        """Samples per channel that may be written now."""
        return self.size - max(0, self.written - self.generated)

    def put(self, codes: Codes) -> None:
        """Add samples, shape (channels, n) with n at most the space."""
        count = codes.shape[1]
        begin = self.written % self.size
        first = min(count, self.size - begin)
        self._ring[:, begin : begin + first] = codes[:, :first]
        self._ring[:, : count - first] = codes[:, first:]
        self.written += count

    def take(self, count: int, *, again: bool) -> Codes:
        """The next samples to generate, shape (channels, n): `count` of them, or fewer if the ring runs dry.

        Parameters
        ----------
        count : int
        again : bool
            Whether samples may be generated again.
        """
        if not again:
            count = min(count, self.written - self.generated)
        places = (self.generated + np.arange(count)) % (self.filled or 1)
        self.generated += count
        return self._ring[:, places]

    def rewind(self) -> None:
        """Begin again with what the ring holds, as a task that is started again does."""
        self.written = self.filled
        self.generated = 0
