"""The fleet: records leave each station once and whole for a broker (`uplink`), and reach a database (`collect`).

Nothing here works at the station: it asks as any client does, with a key that may observe, and what comes down to it
is only how far the records are stored.
"""
