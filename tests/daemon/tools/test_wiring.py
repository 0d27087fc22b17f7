"""Wiring of the simulated station in its station.toml."""

import tomllib

from daemon.tools.demo.wiring import channels_of, wiring_toml

HARNESS = {"101": "CLK", "102": "AVERYLONGNAMEO", "103": "SPARE"}


def test_nets_are_found_by_their_names_also_where_the_netlist_cut_them() -> None:
    assert channels_of(["CLK", "AVeryLongNameOfANet", "GONE", "CLK"], HARNESS) == {
        "AVeryLongNameOfANet": 102,
        "CLK": 101,
    }


def test_the_sections_are_toml_whatever_a_net_is_called() -> None:
    odd = '/a "b"\\{c}.ä'
    read = tomllib.loads(wiring_toml([odd, "CLK"], {"7": odd, "8": "CLK"}, "127.0.0.1:5025"))
    assert read["meter"]["channels"] == {odd: 7, "CLK": 8}
    assert (read["meter"]["address"], read["meter"]["contact_channel"]) == ("127.0.0.1:5025", 1)
    assert read["reference"] != read["brush"]


def test_a_harness_of_hundreds_of_nets_is_in_lines_that_a_person_can_read() -> None:
    harness = {str(100 + k): f"/FPGA/BANK{k}.{k}" for k in range(400)}
    text = wiring_toml(harness.values(), harness, "127.0.0.1:5025")
    assert max(map(len, text.splitlines())) < 100
    assert len(tomllib.loads(text)["meter"]["channels"]) == 400
