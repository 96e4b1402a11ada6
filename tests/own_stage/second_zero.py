"""A second zero of the coupling: a part of the drive that follows the voltage at once."""

from dataclasses import dataclass
from typing import ClassVar

from ipmclab.model.blocks import block
from ipmclab.model.kinds import register
from ipmclab.model.parameters import Declaration
from ipmclab.model.stages.kind import LITTLE, StageKind, Trial, is_there
from ipmclab.units import NUMBER


@dataclass(frozen=True)
class SecondZero:
    """Both drives get beta d(0) s^2/(s^2 + P_1d s + P_2d) V more: the numerator of d(s) becomes quadratic."""

    declarations: ClassVar = (
        Declaration("second_zero.share", NUMBER, "β", -10.0, 10.0, "linear", typical=0.2, scale=0.1),
    )

    def block(self, values):
        """``node_voltage`` and both drives to both drives: it stands in them."""
        p1, p2 = values["coupling.p1"], values["coupling.p2"]
        size = values["second_zero.share"] * values["coupling.gain"] * values["coupling.zero"] / p2
        added = [-size, -size * p1 / p2]
        return block(
            states=["second_zero.filtered_voltage", "second_zero.filtered_voltage_rate"],
            inputs=["displacement_drive", "force_drive", "node_voltage"],
            outputs=["displacement_drive", "force_drive"],
            a=[[0.0, 1.0], [-p2, -p1]],
            b=[[0.0, 0.0, 0.0], [0.0, 0.0, p2]],
            c=[added, added],
            d=[[1.0, 0.0, size], [0.0, 1.0, size]],
        )


def trials(values, excitation):
    """A hundredth of it, where there is none yet."""
    if not is_there(values, "second_zero."):
        yield Trial("second_zero", {"second_zero.share": LITTLE}, both_ways=True)


register(
    StageKind(
        name="second_zero",
        prefix="second_zero.",
        group="second_zero",
        example=True,
        compared_as="second_zero",
        outputs=("displacement", "force"),
        off=("share",),
        shows="a motion that follows the edges of the voltage at once",
        to_determine="record displacement or force at a higher rate, with steps",
        trials=trials,
        build=lambda _count: SecondZero(),
    )
)
