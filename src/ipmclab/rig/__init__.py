"""The rig: what applies a signal to a strip and reads the response, real or virtual."""

from ipmclab.rig.channels import THESIS_RIG as THESIS_RIG
from ipmclab.rig.channels import Channel as Channel
from ipmclab.rig.channels import Converter as Converter
from ipmclab.rig.channels import Rig as Rig
from ipmclab.rig.recording.control import Control as Control
from ipmclab.rig.recording.recorder import record as record
from ipmclab.rig.safety.limits import Limit as Limit
from ipmclab.rig.safety.limits import Limits as Limits
from ipmclab.rig.virtual import VirtualBench as VirtualBench
