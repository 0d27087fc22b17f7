"""SCPI as the simulated meter reads it, against the rules of the standards."""

import pytest

from sim_hw.electric.scpi import ErrorQueue, ScpiError, channel_list, number, pattern, units


@pytest.mark.parametrize(
    ("message", "headers"),
    [
        ("CONF:RES 100", ["CONF:RES"]),
        (":conf:res;*opc?;fres", ["CONF:RES", "*OPC", "CONF:FRES"]),
        ("RES:NPLC 1;RANG 100", ["RES:NPLC", "RES:RANG"]),
        ("RES:NPLC 1;:VOLT:RANG 1", ["RES:NPLC", "VOLT:RANG"]),
        ("CONF:RES 100;RES:NPLC 1", ["CONF:RES", "CONF:RES:NPLC"]),
        ("*CLS; *RST ;", ["*CLS", "*RST"]),
        ("", []),
    ],
)
def test_a_header_goes_on_where_the_one_before_it_was(message: str, headers: list[str]) -> None:
    assert [unit.header for unit in units(message)] == headers


def test_parameters_are_parted_by_commas_outside_of_lists_and_quotes() -> None:
    (unit,) = units("ROUT:CLOS (@101,102), 'a;b', MIN")
    assert unit.parameters == ("(@101,102)", "'a;b'", "MIN")
    assert units("MEAS:RES? 100,0.1")[0].query is True


@pytest.mark.parametrize(
    ("header", "fits", "not_"),
    [
        ("RESistance:NPLCycles", ["RES:NPLC", "RESISTANCE:NPLCYCLES", "RES:NPLCYCLES"], ["RESI:NPLC", "RES"]),
        ("[SENSe:]VOLTage[:DC]:RANGe", ["VOLT:RANG", "SENS:VOLT:DC:RANGE"], ["SEN:VOLT:RANG", "VOLT:AC:RANG"]),
        ("SYSTem:ERRor[:NEXT]", ["SYST:ERR", "SYSTEM:ERROR:NEXT"], ["SYST:ERRO", "SYST:ERR:NEX"]),
        ("*IDN", ["*IDN"], ["IDN", "*IDNX"]),
    ],
)  # fmt: skip
def test_a_word_is_its_short_or_its_long_form_and_nothing_between(
    header: str, fits: list[str], not_: list[str]
) -> None:
    assert all(pattern(header).fullmatch(word) for word in fits)
    assert not any(pattern(header).fullmatch(word) for word in not_)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [("1e2", "", 100.0), ("+.5", "", 0.5), ("1 KOHM", "OHM", 1e3), ("1MOHM", "OHM", 1e6), ("10 nF", "F", 1e-8)],
)  # fmt: skip
def test_a_number_may_have_a_suffix(text: str, unit: str, value: float) -> None:
    assert number(text, unit=unit) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "unit", "code"), [("ten", "", -104), ("1 V", "OHM", -131), ("1 XOHM", "OHM", -131), ("1,5", "", -104)]
)
def test_what_is_no_number_is_an_error_of_its_kind(text: str, unit: str, code: int) -> None:
    with pytest.raises(ScpiError) as caught:
        number(text, unit=unit)
    assert caught.value.entry[0] == code


def test_a_channel_list_has_ranges() -> None:
    assert channel_list("(@101,103:105)") == (101, 103, 104, 105)
    for text in ("101", "(101)", "(@)", "(@1:999999999)", "(@5:1)"):
        with pytest.raises(ScpiError):
            channel_list(text)


def test_the_error_queue_is_first_in_first_out_and_says_when_it_is_full() -> None:
    queue = ErrorQueue()
    assert queue.take() == '+0,"No error"'
    for code in range(1, 25):
        queue.put((-code, "x"))
    taken = [queue.take() for _ in range(20)]
    assert taken[0] == '-1,"x"'
    assert taken[-1] == '-350,"Queue overflow"'
    assert queue.take() == '+0,"No error"'
