"""Calls on custom scales: they live as long as the server, and none is saved."""

from __future__ import annotations

from typing import Any, Literal

from virtual_cdaq.model.scales import Scale, reverse_coefficients
from virtual_cdaq.protocol import message
from virtual_cdaq.service import Service, call


def _create(service: Service, request: Any, kind: Literal["linear", "map", "polynomial", "table"], *sides: Any) -> None:
    before, after = (tuple(float(value) for value in side) for side in sides)
    units = request.pre_scaled_units_raw or request.pre_scaled_units
    service.chassis.scales[request.name] = Scale(request.name, kind, before, after, units, request.scaled_units)


@call("CreateLinScale")
def _linear(service: Service, request: Any) -> Any:
    _create(service, request, "linear", (request.y_intercept, request.slope), ())
    return message("CreateLinScaleResponse")()


@call("CreateMapScale")
def _map(service: Service, request: Any) -> Any:
    before, after = (request.prescaled_min, request.prescaled_max), (request.scaled_min, request.scaled_max)
    _create(service, request, "map", before, after)
    return message("CreateMapScaleResponse")()


@call("CreatePolynomialScale")
def _polynomial(service: Service, request: Any) -> Any:
    _create(service, request, "polynomial", request.forward_coeffs, request.reverse_coeffs)
    return message("CreatePolynomialScaleResponse")()


@call("CreateTableScale")
def _table(service: Service, request: Any) -> Any:
    _create(service, request, "table", request.prescaled_vals, request.scaled_vals)
    return message("CreateTableScaleResponse")()


@call("CalculateReversePolyCoeff")
def _reverse(_: Service, request: Any) -> Any:
    found = reverse_coefficients(
        tuple(request.forward_coeffs),
        request.min_val_x,
        request.max_val_x,
        request.num_points_to_compute,
        request.reverse_poly_order,
    )
    return message("CalculateReversePolyCoeffResponse")(reverse_coeffs=found)
