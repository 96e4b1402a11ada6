"""The sheet-resistance meter: on the virtual bench, and through NI's client on the stand-in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ipmclab import InputError, load_actuator
from ipmclab.rig.bench import BenchError
from ipmclab.rig.channels import THESIS_RIG, FourProbe, VirtualStrip
from ipmclab.rig.operator_actions import carry_out
from ipmclab.rig.plant import StripPlant
from ipmclab.rig.sheet_meter import read_four_probe
from tests.rig.stand_in import serve

SQUARE = load_actuator("friend-2")["circuit.sheet_resistance"]


def test_a_virtual_strip_is_read_with_the_meters_offset() -> None:
    rig = replace(THESIS_RIG, virtual=VirtualStrip(meter_offset=0.03))
    found = read_four_probe(rig, count=200)
    assert found.mean == pytest.approx(2.0 * SQUARE + 0.03, abs=5e-4)
    assert found.scatter == pytest.approx(1.2e-3, rel=0.2)
    assert read_four_probe(rig, count=200, shorted=True).mean == pytest.approx(0.03, abs=5e-4)


def test_points_are_read_with_their_factor() -> None:
    probe = FourProbe(spacing=4e-3, contacts="points")
    found = read_four_probe(replace(THESIS_RIG, four_probe=probe), count=50)
    assert probe.sheet_resistance(found.mean, width=5e-3, length=30e-3) == pytest.approx(SQUARE, rel=1e-3)


def test_the_stand_in_is_read_through_nis_client() -> None:
    with serve("lock-step") as stand_in:
        found = read_four_probe(stand_in.rig, count=20)
        assert found.mean == pytest.approx(2.0 * SQUARE, abs=2e-3)
        assert 0.3e-3 < found.scatter < 3e-3  # 0.003 K of a Pt100 at two readings a second
        assert "NI 9217 cDAQ1Mod3" in found.bench
        with stand_in.chassis.lock:
            carry_out(stand_in.plant, "probes shorted")
        assert read_four_probe(stand_in.rig, count=5, shorted=True).mean == pytest.approx(0.0, abs=3e-3)
        assert stand_in.level == 0.0
        assert stand_in.reserved == []


def test_contacts_that_do_not_touch() -> None:
    with serve("lock-step", faults=["open cDAQ1Mod3/ai0 at 0 s of serving"]) as stand_in:
        with pytest.raises(BenchError, match="a contact does not touch") as error:
            read_four_probe(stand_in.rig, count=5)
        assert error.value.code == "probe-open"
        assert error.value.exit_status == 1


@pytest.mark.parametrize(
    ("rig", "count", "code"),
    [(replace(THESIS_RIG, four_probe=None), 20, "no-four-probe"), (THESIS_RIG, 2, "out-of-range")],
)
def test_what_cannot_be_read(rig, count, code) -> None:
    with pytest.raises(InputError) as error:
        read_four_probe(rig, count=count)
    assert error.value.code == code
    assert error.value.repair


def test_both_kinds_of_contacts_stand_for_the_same_sheet() -> None:
    lines, points = (
        StripPlant(replace(THESIS_RIG, four_probe=FourProbe("cDAQ1Mod3/ai0", 4e-3, contacts=kind))).advance([1.0], {})
        for kind in ("line", "points")
    )
    # In the middle of a narrow strip the current is nearly even across it.
    assert points["cDAQ1Mod3/ai0"][0] == pytest.approx(lines["cDAQ1Mod3/ai0"][0], rel=0.01)
    assert np.isfinite(points["cDAQ1Mod3/ai0"]).all()
