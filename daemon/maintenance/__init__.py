"""Preventive maintenance: what the station's own numbers say of its health, before a landing fails.

Pure modules: `xmr_chart`, `proportion_test` and `limit_check` judge streams of numbers; `catalogue` lists every watch
as data, `panel` holds them; `signals`, `device_signals`, `calibration_signals` and `image_metrics` turn jobs, devices,
calibrations and images into numbers; `alerts` are those that stand. `monitor` is the one that awaits: it feeds the
panel and tells what it finds.
"""
