"""Preventive maintenance: what the station's own numbers say of its health, before a landing fails.

Pure rooms: `points`, `chart`, `share`, `limit` judge streams of numbers; `catalogue` lists every watch as data, `panel`
holds them; `streams` and `measure` turn jobs, devices and pictures into numbers; `alerts` is what stands. `monitor` is
the one that awaits: it feeds the panel and tells what it finds.
"""
