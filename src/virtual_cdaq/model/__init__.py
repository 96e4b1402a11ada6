"""The chassis without any wire protocol: clock, modules, converters, engines, tasks, buffers, faults."""
