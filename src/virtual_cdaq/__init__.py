"""A stand-in NI cDAQ-9174 that speaks NI's own gRPC protocol, so that the unmodified official client drives it.

The package knows nothing of the laboratory around it: what lies behind the terminals is a
:class:`~virtual_cdaq.model.plant.Plant` that its user passes in. ``README.md`` beside this file says what the stand-in
does and what it does not prove.
"""
