"""What is wrong with a record, and its metrics."""

from __future__ import annotations

from ipmclab.quality.check import check as check
from ipmclab.quality.metrics import Metric as Metric
from ipmclab.quality.metrics import measure as measure
from ipmclab.quality.metrics import shows_zero as shows_zero
from ipmclab.quality.noise import noise_level as noise_level
from ipmclab.quality.pair import PairedRuns as PairedRuns
from ipmclab.quality.pair import pair as pair
from ipmclab.quality.period import period_of as period_of
from ipmclab.quality.together import check_together as check_together
from ipmclab.quality.usable import censored as censored
from ipmclab.quality.usable import usable as usable
