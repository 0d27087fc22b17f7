"""Nets of the demonstration board, tested with OpenHTF: `python doc/examples/openhtf_nets.py ENDPOINT SERIAL`."""

import sys

import openhtf as htf
from openhtf.output.callbacks import console_summary

from daemon.adapters.openhtf_plug import ReprobePlug


@htf.measures(htf.Measurement("clk_ohms").in_range(maximum=2.0).with_units(htf.units.OHM))
@htf.plug(reprobe=ReprobePlug)
def clk(test, reprobe):
    """Measure the clock's net from its point to its pin of the harness."""
    probed = reprobe.probe("TP1", board_id=test.test_record.dut_id)
    test.logger.info("%r", probed)
    test.measurements.clk_ohms = probed.ohms


def main():
    """Test one board; exit 0 if it passes."""
    endpoint, serial = sys.argv[1:]
    htf.util.configuration.CONF.load(reprobe_station=endpoint)
    test = htf.Test(clk, test_name="demo nets")
    test.add_output_callbacks(console_summary.ConsoleSummary())
    return 0 if test.execute(test_start=lambda: serial) else 1


if __name__ == "__main__":
    sys.exit(main())
