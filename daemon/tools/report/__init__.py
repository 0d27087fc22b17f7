"""The HTML pages of calibrations: `python -m daemon.tools.report RECORD.json [--previous OLD.json] -o PAGE.html`.

A process of its own, started for one page and gone when it is written. The plots are matplotlib's, which takes some
60 MB and a second to import and never gives them back; a service that runs for months on a small station should not
carry that, and neither should a page that hangs or fails be able to hold up a correction. So nothing outside this
folder imports what draws: `process` starts the command, niced and with a time limit, and reads its exit status.

`index`, `process` and `command` are free of matplotlib.
"""
