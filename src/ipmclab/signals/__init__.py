"""Signals: the voltage that is applied over time, as values and as text.

A signal is a function of time alone, so that it gives the same voltage at a time however the
record is cut into blocks. It acts from row 0, or from its ``delay``; before that it is 0 V
(its offset belongs to it and starts with it), and after its end it is 0 V again.

=================================  =========================================================
text                               meaning
=================================  =========================================================
``step 1 V`` (or ``dc 1 V``)       constant
``sine 1 V 0.1 Hz``                starts at 0 and rises
``cosine 1 V 0.1 Hz``              starts at its peak
``square 1 V 0.1 Hz``              starts with its positive half period
``triangle 1 V 0.1 Hz``            starts at 0 and rises to its peak in a quarter period
``chirp 1 V 0.05 Hz 5 Hz``         frequency grows by equal ratios in equal times during
                                   ``sweep_time`` (default 40 s), then stays
``multisine 1 V 0.05 Hz 5 Hz``     every multiple of the lowest frequency up to the highest,
                                   equal amplitudes, Schroeder phases, 1 V peak;
                                   ``harmonics=odd`` leaves the even ones out, ``left_out=4``
                                   one of each four, by ``seed``; ``phases=random``
``prbs 1 V 0.5 s``                 maximum length binary sequence, one bit each 0.5 s
                                   (default 0.1 s); ``order`` (default 10: it repeats after
                                   2^10 - 1 bits), ``seed``
``random 1 V 0.5 s``               uniform between -1 V and 1 V, a new level each 0.5 s
                                   (default 0.1 s); ``seed``
``file PATH``                      samples from a CSV file or a run (.nc), each held until the next
``samples 0 s 1 V 2 s 0.5 V``      the same, written out
=================================  =========================================================

Amplitudes are peaks, not peak to peak. Options are named and come last:
``sine 1 V 0.1 Hz phase=90 deg offset=0.2 V delay=1 s``. Signals are joined by ``then``; each but
the last says how long it lasts, and its own time starts at 0:
``sine 1 V 0.1 Hz for 20 s then step 0.5 V for 5 s``.
"""

from ipmclab.signals.broadband import Multisine as Multisine
from ipmclab.signals.broadband import Prbs as Prbs
from ipmclab.signals.broadband import Random as Random
from ipmclab.signals.samples import Samples as Samples
from ipmclab.signals.sequence import Sequence as Sequence
from ipmclab.signals.signal import Signal as Signal
from ipmclab.signals.text import parse as parse
from ipmclab.signals.tones import Chirp as Chirp
from ipmclab.signals.tones import Cosine as Cosine
from ipmclab.signals.tones import Sine as Sine
from ipmclab.signals.tones import Square as Square
from ipmclab.signals.tones import Step as Step
from ipmclab.signals.tones import Triangle as Triangle

__all__ = [
    "Chirp",
    "Cosine",
    "Multisine",
    "Prbs",
    "Random",
    "Samples",
    "Sequence",
    "Signal",
    "Sine",
    "Square",
    "Step",
    "Triangle",
    "parse",
]
