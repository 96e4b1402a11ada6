"""Custom scales through NI's client: what a program counts in, made of volts and ohms and back."""

import numpy as np
import pytest
from nidaqmx import DaqError, Scale
from nidaqmx.constants import (
    ExcitationSource,
    ResistanceConfiguration,
    RTDType,
    TemperatureUnits,
    UnitsPreScaled,
    VoltageUnits,
)
from nidaqmx.constants import ScaleType as Type

from virtual_cdaq.model.errors import ChassisError
from virtual_cdaq.model.scales import Scale as Model
from virtual_cdaq.model.scales import reverse_coefficients

VOLTS = UnitsPreScaled.VOLTS.value


def scaled(bench, name, **limits):
    """A task that reads back, in the units of a scale, what it gives out at its output in the same units."""
    reading, writing = bench.task(), bench.task()
    more = {"units": VoltageUnits.FROM_CUSTOM_SCALE, "custom_scale_name": name, **limits}
    reading.ai_channels.add_ai_voltage_chan("cDAQ1Mod1/ai3", **more)
    writing.ao_channels.add_ao_voltage_chan("cDAQ1Mod2/ao0", **more)
    return reading, writing


def test_what_is_written_in_its_units_is_read_in_its_units(bench):
    """50 mN a volt, 1 N at 0 V."""
    scale = Scale.create_lin_scale("force", 0.05, 1.0, UnitsPreScaled.VOLTS, "N", grpc_options=bench.options)
    reading, writing = scaled(bench, "force", min_val=0.9, max_val=1.1)
    with reading, writing:
        writing.write(1.075)
        assert bench.chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(1.5, abs=2e-4)
        assert reading.read() == pytest.approx(1.075, abs=1e-4)
        assert (reading.ai_channels[0].ai_min, reading.ai_channels[0].ai_max) == pytest.approx((0.75, 1.25))
        assert reading.ai_channels[0].ai_custom_scale.scaled_units == "N"
        with pytest.raises(DaqError, match=r"Allowed: 0\.9 to 1\.1") as beyond:
            writing.write(1.2)
        assert beyond.value.error_code == -200561
        scale.lin_slope = 0.1
        assert reading.read() == pytest.approx(1.15, abs=2e-4)
        reading.ai_channels[0].ai_voltage_units = VoltageUnits.VOLTS
        assert reading.read() == pytest.approx(1.5, abs=1e-3)


def test_maps_tables_and_polynomials(bench):
    options = {"grpc_options": bench.options}
    Scale.create_map_scale("map", -10.0, 10.0, 0.0, 100.0, **options)
    Scale.create_table_scale("table", [2.0, -2.0, 0.0], [8.0, -4.0, 0.0], **options)
    back = Scale.calculate_reverse_poly_coeff([1.0, 2.0], -10.0, 10.0, 1000, 1, **options)
    Scale.create_polynomial_scale("polynomial", [1.0, 2.0], back, **options)
    for name, value, volts in (
        ("map", 65.0, 3.0),
        ("table", 4.0, 1.0),
        ("table", -2.0, -1.0),
        ("polynomial", 4.0, 1.5),
    ):
        reading, writing = scaled(bench, name, min_val=value - 1.0, max_val=value + 1.0)
        with reading, writing:
            writing.write(value)
            assert bench.chassis.levels["cDAQ1Mod2/ao0"] == pytest.approx(volts, abs=3e-4)
            assert reading.read() == pytest.approx(value, abs=5e-3)


def test_a_thermometer_with_a_scale_of_its_own(bench):
    scale = Scale.create_lin_scale("above 20 degC", 1.0, -20.0, UnitsPreScaled.DEG_C, grpc_options=bench.options)
    with bench.task() as task:
        channel = task.ai_channels.add_ai_rtd_chan(
            "cDAQ1Mod3/ai1",
            rtd_type=RTDType.PT_3851,
            resistance_config=ResistanceConfiguration.FOUR_WIRE,
            current_excit_source=ExcitationSource.INTERNAL,
            current_excit_val=1e-3,
        )
        channel.ai_custom_scale = scale
        channel.ai_temp_units = TemperatureUnits.FROM_CUSTOM_SCALE
        assert task.read() == pytest.approx(2.0, abs=0.15)
        channel.ai_custom_scale = Scale.create_lin_scale("twice", 2.0, grpc_options=bench.options)  # of volts
        with pytest.raises(DaqError, match="PreScaledUnits"):
            channel.ai_temp_units = TemperatureUnits.FROM_CUSTOM_SCALE
        del channel.ai_custom_scale
        del channel.ai_temp_units
        assert task.read() == pytest.approx(22.0, abs=0.15)


def test_a_scale_is_found_by_its_name_and_fits_the_measurement(bench):
    Scale.create_lin_scale("speed", 2.0, pre_scaled_units=UnitsPreScaled.AMPS, grpc_options=bench.options)
    scale = Scale.create_lin_scale("twice", 2.0, grpc_options=bench.options)
    assert (scale.scale_type, scale.pre_scaled_units, scale.lin_y_intercept) == (Type.LINEAR, UnitsPreScaled.VOLTS, 0.0)
    with bench.task() as task:
        for name, code in (("nothing", -200378), ("speed", -200077)):
            with pytest.raises(DaqError) as refused:
                task.ai_channels.add_ai_voltage_chan(
                    "cDAQ1Mod1/ai3", units=VoltageUnits.FROM_CUSTOM_SCALE, custom_scale_name=name
                )
            assert refused.value.error_code == code
    with pytest.raises(DaqError) as other:
        _ = scale.poly_forward_coeff
    assert other.value.error_code == -200601
    with pytest.raises(DaqError) as flat:
        scale.lin_slope = 0.0
    assert (flat.value.error_code, scale.lin_slope) == (-200409, 2.0)


@pytest.mark.parametrize(
    ("kind", "before", "after", "code"),
    [
        ("linear", (1.0, 0.0), (), -200409),
        ("map", (1.0, 1.0), (0.0, 1.0), -200602),
        ("map", (0.0, 1.0), (1.0, 1.0), -200603),
        ("polynomial", (), (), -200404),
        ("polynomial", (), (1.0,), -200405),
        ("polynomial", (1.0,), (), -200406),
        ("polynomial", (0.0,), (1.0,), -200407),
        ("polynomial", (1.0,), (0.0,), -200408),
        ("table", (1.0,), (1.0, 2.0), -200434),
        ("table", (1.0, 2.0), (1.0,), -200433),
        ("table", (1.0, 2.0), (1.0, 2.0, 3.0), -200350),
        ("table", (1.0, 1.0), (1.0, 2.0), -200598),
        ("table", (1.0, 2.0), (1.0, 1.0), -200599),
    ],
)
def test_a_scale_that_does_not_lead_back_is_refused(kind, before, after, code):
    with pytest.raises(ChassisError) as refused:
        Model("bad", kind, before, after, VOLTS)
    assert refused.value.code == code


def test_a_polynomial_leads_back_as_well_as_its_order_can():
    back = reverse_coefficients((0.0, 1.0, 0.01), 0.0, 10.0, 200, 4)
    scale = Model("bent", "polynomial", (0.0, 1.0, 0.01), tuple(back), VOLTS)
    values = np.linspace(0.0, 10.0, 7)
    assert scale.reverse(scale.forward(values)) == pytest.approx(values, abs=1e-4)
    with pytest.raises(ChassisError):
        reverse_coefficients((0.0, 1.0), 1.0, 0.0, 10, 1)
