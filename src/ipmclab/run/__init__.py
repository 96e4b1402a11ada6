"""Run and Finding: what the rooms above give to each other."""

from __future__ import annotations

from ipmclab.run.arrays import FloatArray as FloatArray
from ipmclab.run.arrays import check_time as check_time
from ipmclab.run.channels import QUALITY_FLAGS as QUALITY_FLAGS
from ipmclab.run.channels import SLOW_CHANNELS as SLOW_CHANNELS
from ipmclab.run.channels import Hold as Hold
from ipmclab.run.channels import raw_name as raw_name
from ipmclab.run.finding import Effect as Effect
from ipmclab.run.finding import Finding as Finding
from ipmclab.run.finding import Severity as Severity
from ipmclab.run.metadata import Mark as Mark
from ipmclab.run.metadata import RunMetadata as RunMetadata
from ipmclab.run.metadata import ZeroReading as ZeroReading
from ipmclab.run.run import Readings as Readings
from ipmclab.run.run import Run as Run
