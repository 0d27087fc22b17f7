"""Gerber is drawn as the specification says: areas are held against arithmetic and against another reader."""

import math
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.tools.cad.gerber import read_gerber
from daemon.tools.cad.model import Shape

HEAD = "%FSLAX46Y46*%\n%MOMM*%\n%LPD*%\nG75*\nG01*\n"
PX_MM = 0.002


def area(text: str, box: tuple[float, float, float, float] = (-3.0, -3.0, 3.0, 3.0)) -> float:
    """Return the dark area in mm2, painted in order."""
    return float(paint(read_gerber(text).shapes, box).sum()) * PX_MM**2


def paint(shapes: list[Shape], box: tuple[float, float, float, float], px_mm: float = PX_MM) -> np.ndarray:
    """Paint shapes in order; pixels whose centre is inside."""
    x0, y0, x1, y1 = box
    canvas = np.zeros((round((y1 - y0) / px_mm), round((x1 - x0) / px_mm)), np.uint8)
    for shape in shapes:
        at = np.round(((shape.points_mm - (x0, y0)) / px_mm - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(canvas, [at], 1 if shape.dark else 0, shift=8)
    return canvas


def flash(aperture: str, head: str = HEAD) -> str:
    return f"{head}{aperture}\nD10*\nX0Y0D03*\nM02*\n"


RINGS = math.pi / 4 * (2.0**2 - 1.6**2 + 1.0**2 - 0.6**2)
CROSS = 2 * 2.0 * 0.05 - 0.05**2
MOIRE = RINGS + CROSS - 4 * 2 * 0.2 * 0.05
"""Two rings of 0.2 mm and a cross of 0.05 mm, which each ring crosses four times."""
FLASHES = {
    "disc": ("%ADD10C,1.0*%", math.pi / 4),
    "ring": ("%ADD10C,1.0X0.5*%", math.pi / 4 * 0.75),
    "rectangle": ("%ADD10R,1.0X2.0*%", 2.0),
    "rectangle with a hole": ("%ADD10R,1.0X2.0X0.5*%", 2.0 - math.pi / 16),
    "obround": ("%ADD10O,2.0X1.0*%", 1.0 + math.pi / 4),
    "round obround": ("%ADD10O,1.0X1.0*%", math.pi / 4),
    "hexagon": ("%ADD10P,2.0X6*%", 1.5 * math.sqrt(3)),
    "macro of a rounded rectangle": (
        ("%AMRR*0 comment*4,1,4,$2,$3,-$2,$3,-$2,-$3,$2,-$3,$2,$3,0*1,1,$1+$1,$2,$3*1,1,$1+$1,-$2,$3*1,1,$1+$1,-$2,-$3*"
        "1,1,$1+$1,$2,-$3*20,1,$1+$1,$2,$3,-$2,$3,0*20,1,$1+$1,-$2,$3,-$2,-$3,0*20,1,$1+$1,-$2,-$3,$2,-$3,0*"
        "20,1,$1+$1,$2,-$3,$2,$3,0*%\n%ADD10RR,0.2X0.8X0.3*%"), 2.0 * 1.0 - 0.04 * (4 - math.pi)),
    "macro turned": ("%AMT*21,1,2.0,1.0,0.5,0,30*%\n%ADD10T*%", 2.0),
    "macro of old lines": ("%AML*2,1,0.5,-1,0,1,0,0*22,1,1,1,-0.5,1,0*%\n%ADD10L*%", 1.0 + 1.0),
    "thermal": ("%AMTH*7,0,0,2.0,1.0,0.2,0*%\n%ADD10TH*%", math.pi * 0.75 - 4 * 0.2 * 0.5),
    "macro with variables": ("%AMV*$3=$1x2*$4=($3-$2)/1*1,1,$4,0,0*%\n%ADD10V,1.0X0.5*%", math.pi / 4 * 2.25),
    "macro with exposure off": ("%AMO*1,1,2.0,0,0*1,0,1.0,0,0*%\n%ADD10O,*%", math.pi * 0.75),
    "moire": ("%AMM*6,0,0,2.0,0.2,0.3,2,0.05,2.0,0*%\n%ADD10M*%", MOIRE),
    "block aperture": (
        "%ADD11C,0.5*%\n%ABD10*%\nD11*\nX-1000000Y0D03*\nX1000000Y0D03*\n%AB*%", 2 * math.pi / 16),
}  # fmt: skip


@pytest.mark.parametrize("kind", FLASHES)
def test_a_flash_has_its_area(kind: str) -> None:
    aperture, wanted = FLASHES[kind]
    assert area(flash(aperture)) == pytest.approx(wanted, rel=0.012)


RING = "%AMRING*1,1,1.0,0,0*1,0,0.6,0,0*%\n%ADD11RING*%"
OVER_COPPER = {
    "dark": ("D11*\nX0Y0D03*", 4.0),
    "clear": ("%LPC*%\nD11*\nX0Y0D03*", 4.0 - math.pi / 4 * (1.0 - 0.36)),
    "clear beside": ("%LPC*%\nD11*\nX1000000Y0D03*", 4.0 - math.pi / 8 * (1.0 - 0.36)),
}


@pytest.mark.parametrize("kind", OVER_COPPER)
def test_what_a_macro_leaves_out_stays_as_it_was_below(kind: str) -> None:
    flashed, wanted = OVER_COPPER[kind]
    assert area(f"{HEAD}%ADD10R,2.0X2.0*%\n{RING}\nD10*\nX0Y0D03*\n{flashed}\nM02*\n") == pytest.approx(
        wanted, rel=0.005
    )


def test_pieces_of_a_macro_that_several_removals_cut_apart_have_their_area() -> None:
    grid = (
        "%AMG*21,1,2.0,2.0,0,0,30*21,0,0.2,3.0,0,0,30*21,0,3.0,0.2,0,0,30*1,0,0.4,0,0*"
        "1,0,0.2,0.6,0.6*1,0,0.2,-0.6,-0.6*%"
    )
    arm_in_disc = 2 * (0.1 * math.sqrt(0.03) + 0.04 * math.asin(0.5))
    cross = 2 * 0.4 - 0.04 + math.pi * 0.04 - (2 * arm_in_disc - 0.04)
    found = area(f"{HEAD}{grid}\n%ADD10G*%\nD10*\nX0Y0D03*\nM02*\n")
    assert found == pytest.approx(4.0 - cross - 2 * math.pi * 0.01, rel=0.01)


BLOCK = (
    "%ADD11C,0.5*%\n%ABD10*%\n%TO.N,A*%\nD11*\nX1000000Y0D03*\n%TO.N,B*%\nX2000000Y1000000D03*\n%TD*%\n%AB*%\nD10*\n"
)


def test_pads_in_a_block_are_pads_of_their_own_wherever_it_is_flashed() -> None:
    turned = "%LMX*%\n%LR90*%\n%LS2*%\nX20000000Y10000000D03*"
    shapes = read_gerber(f"{HEAD}{BLOCK}X10000000Y10000000D03*\n{turned}\nM02*\n").shapes
    assert [s.net for s in shapes] == ["A", "B", "A", "B"]
    assert len({s.item for s in shapes}) == 4
    wanted = [(11.0, 10.0, 0.5), (12.0, 11.0, 0.5), (20.0, 8.0, 1.0), (18.0, 6.0, 1.0)]
    for shape, disc in zip(shapes, wanted, strict=True):
        assert shape.round_mm == pytest.approx(disc)
        assert shape.place_mm == pytest.approx(disc[:2])
        assert shape.points_mm.mean(axis=0) == pytest.approx(disc[:2], abs=1e-6)


def test_pen_ways_of_a_block_lie_where_it_is_flashed() -> None:
    block = "%ADD11C,0.1*%\n%ABD10*%\nD11*\nX0Y0D02*\nX5000000Y0D01*\n%AB*%\nD10*\nX10000000Y10000000D03*\n"
    (path,) = read_gerber(f"{HEAD}{block}M02*\n").paths
    assert path.points.tolist() == [[10.0, 10.0], [15.0, 10.0]]


def test_blocks_in_blocks_without_end_are_refused() -> None:
    blocks = "".join(f"%ABD{k}*%\nD{k - 1}*\nX0Y0D03*\nX1000000Y0D03*\n%AB*%\n" for k in range(12, 45))
    with pytest.raises(ValueError, match="too many shapes to draw"):
        read_gerber(f"{HEAD}%ADD11C,0.5*%\n{blocks}D44*\nX0Y0D03*\nM02*\n")


@pytest.mark.parametrize(
    "aperture",
    ["%ADD10P,1X2000000*%", "%AMX*5,1,2000000,0,0,1,0*%\n%ADD10X*%", "%AMX*6,0,0,1,0,0,2000000,0,0,0*%\n%ADD10X*%"],
)
def test_a_number_of_corners_or_rings_that_would_fill_the_memory_is_refused(aperture: str) -> None:
    with pytest.raises(ValueError, match="at most 1000 can be drawn"):
        read_gerber(flash(aperture))


DRAWS = {
    "line": ("X0Y0D02*\nX2000000Y0D01*", 2.0 * 0.5 + math.pi * 0.0625),
    "quarter arc": ("G02*\nX-1000000Y0D02*\nX0Y1000000I1000000J0D01*", math.pi / 2 * 0.5 + math.pi * 0.0625),
    "three quarters": ("G03*\nX-1000000Y0D02*\nX0Y1000000I1000000J0D01*", 3 * math.pi / 2 * 0.5 + math.pi * 0.0625),
    "whole circle": ("G02*\nX-1000000Y0D02*\nX-1000000Y0I1000000J0D01*", 2 * math.pi * 0.5),
    "single quadrant": ("G74*\nG02*\nX-1000000Y0D02*\nX0Y1000000I1000000J0D01*", math.pi / 2 * 0.5 + math.pi * 0.0625),
    "region": ("G36*\nX0Y0D02*\nX1000000D01*\nY1000000D01*\nX0D01*\nY0D01*\nG37*", 1.0),
    "two contours": (
        ("G36*\nX0Y0D02*\nX1000000D01*\nY1000000D01*\nX0Y0D01*\nX-2000000D02*\nX-1000000D01*\nY-1000000D01*\nX-2000000Y0D01*\n"
        "G37*"), 1.0),
    "a clear disc": ("X0Y0D02*\nX2000000Y0D01*\n%LPC*%\nX1000000Y0D03*", 2.0 * 0.5 + math.pi * 0.0625 - math.pi / 16),
    "modal operation": ("X0Y0D02*\nX1000000D01*\nX2000000*", 2.0 * 0.5 + math.pi * 0.0625),
    "G54 and leading blanks": ("G54D10*\n X0Y0D02* X2000000Y0D01*", 2.0 * 0.5 + math.pi * 0.0625),
    **{
        f"step and repeat, {said}": (f"%SR{said}*%\nX-1000000Y-1000000D03*\n%SR*%", 3 * math.pi / 16)
        for said in ("X3Y1I1.0", "X3I1.0", "Y3J1.0", "I1.0J0X3Y1", " X3Y1 I+1.0J0")
    },
    "step and repeat": ("%SRX2Y3I1.0J1.0*%\nX-1000000Y-1000000D03*\n%SR*%", 6 * math.pi / 16),
    "scaled": ("%LS2.0*%\nX0Y0D03*\n%LS1.0*%", math.pi / 4),
}  # fmt: skip


@pytest.mark.parametrize("kind", DRAWS)
def test_a_drawing_has_its_area(kind: str) -> None:
    body, wanted = DRAWS[kind]
    assert area(f"{HEAD}%ADD10C,0.5*%\nD10*\n{body}\nM02*\n") == pytest.approx(wanted, rel=0.012)


def test_a_rectangle_turned_or_mirrored_by_the_graphics_state_is_turned() -> None:
    text = f"{HEAD}%AMC*21,1,2,0.2,1,0,0*%\n%ADD10C1*%\n".replace("%ADD10C1", "%ADD10C,1*%\n%ADD11C1").replace(
        "AMC*", "AMC1*"
    )
    upright = read_gerber(f"{text}D11*\n%LR90*%\nX0Y0D03*\nM02*\n").shapes[0].points_mm
    assert upright[:, 1].max() == pytest.approx(2.0)
    assert upright[:, 0].max() == pytest.approx(0.1)
    left = read_gerber(f"{text}D11*\n%LMX*%\nX0Y0D03*\nM02*\n").shapes[0].points_mm
    assert left[:, 0].min() == pytest.approx(-2.0)


@pytest.mark.parametrize(
    ("head", "one_mm"),
    [
        ("%FSLAX24Y24*%\n%MOIN*%\n", "394"),
        ("%FSTAX24Y24*%\n%MOIN*%\n", "000394"),
        ("%FSLAX25Y25*MOIN*%\n", "3937"),
        ("%FSLAX33Y33*%\nG71*\n", "1000"),
        ("%MOMM*%\n%FSLAX34Y34*%\n", "10000"),
        ('%IN "GPS.pcb"*%\n*\n%MOIN*%\n*\n%FSDAX24Y24*%\n*\n', "000394"),
        ("%FSLIX33Y33*%\n%MOMM*%\n", "1000"),
    ],
)
def test_coordinates_are_read_in_their_format(head: str, one_mm: str) -> None:
    layer = read_gerber(f"{head}%ADD10C,0.1*%\nD10*\nX{one_mm}Y-{one_mm}D03*\nM02*\n")
    assert layer.shapes[0].place_mm == pytest.approx((1.0, -1.0), abs=0.002)


def test_attributes_name_pads_as_commands_and_in_comments() -> None:
    for start, end in (("%", "%"), ("G04 #@! ", "")):
        text = (
            f"{HEAD}{start}TA.AperFunction,SMDPad,CuDef*{end}\n%ADD10R,1X1*%\n{start}TD*{end}\nD10*\n"
            f"{start}TO.P,U1,7,PA\\u002C1*{end}\n{start}TO.N,/I2C\\u002FSDA*{end}\nX0Y0D03*\n{start}TD*{end}\nX1000000Y0D03*\nM02*\n"
        )
        named, bare = read_gerber(text).shapes
        assert (named.part, named.pin, named.net, named.function) == ("U1", "7", "/I2C/SDA", "SMDPad")
        assert (bare.part, bare.pin, bare.net) == (None, None, None)


@pytest.mark.parametrize(
    "comment", ["G04 #@! %TF.FileFunction,Copper,L1,Top*%", "G04 #@! %TF.FileFunction,Copper,L1,Top*%*"]
)
def test_eagles_commands_in_comments_do_not_upset_what_follows(comment: str) -> None:
    layer = read_gerber(f"{comment}\n%FSLAX46Y46*%\n%MOMM*%\n%ADD10C,1*%\nD10*\nX1000000Y0D03*\nM02*\n")
    assert layer.attributes[".FileFunction"] == ["Copper", "L1", "Top"]
    assert layer.shapes[0].round_mm == (1.0, 0.0, 1.0)


@pytest.mark.parametrize(("code", "mm"), [("G70", 25.4), ("G71", 1.0)])
def test_a_unit_that_is_said_after_the_apertures_holds_for_them(code: str, mm: float) -> None:
    layer = read_gerber(f"%FSLAX33Y33*%\n%SFA1B1*%\n%ASAXBY*%\n%ADD10C,0.5*%\n{code}*\nD10*\nX1000Y0D03*\nM02*\n")
    assert layer.shapes[0].round_mm == pytest.approx((mm, 0.0, 0.5 * mm))


def test_a_rounded_pad_of_several_pieces_is_one_polygon() -> None:
    layer = read_gerber(flash(FLASHES["macro of a rounded rectangle"][0]))
    assert len(layer.shapes) == 1
    assert layer.shapes[0].place_mm == (0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (HEAD + "%IPNEG*%\nM02*\n", "drawn as a negative"),
        (HEAD + "%ASAYBX*%\nM02*\n", "its axes are exchanged"),
        (HEAD + "%SFA2.0B1.0*%\nM02*\n", "scaled as a whole"),
        (HEAD + "%ADD10C,0.5*%\nD10*\n%SRX3Q2*%\nX0Y0D03*\n%SR*%\nM02*\n", "'SRX3Q2' cannot be drawn"),
        (HEAD + "%ADD11C,1*%\nD10*\nX0Y0D03*\nM02*\n", "an aperture D10 that it does not define"),
        ("G01*\n%ADD10C,0.1*%\nD10*\nX0Y0D02*\nX1Y0D01*\nM02*\n", "no coordinate format"),
        (HEAD + "%AMX*9,1,2*%\n%ADD10X*%\nM02*\n", "no primitive 9"),
        (HEAD + "%AMX*1,1,$1/0,0,0*%\n%ADD10X,1*%\nM02*\n", "cannot be drawn"),
        (HEAD + "%ADD10C,0.5*%\nD10*\n%SRX99999Y99999I1J1*%\nX0Y0D03*\n%SR*%\nM02*\n", "too many to draw"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_words(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        read_gerber(text)


@pytest.mark.parametrize("name", ["demo-F_Cu.gtl", "demo-F_Mask.gts", "demo-B_Cu.gbl", "demo-F_Silkscreen.gto"])
def test_another_reader_draws_the_same(name: str) -> None:
    gerbonara = pytest.importorskip("gerbonara")
    from sim_hw.board.shapes import shapes

    path = Path(__file__).parents[4] / "sim_hw" / "demo_board" / name
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = [Shape(s.outline_mm, s.dark) for s in shapes(gerbonara.GerberFile.open(path).objects)]
    box = (9.0, 9.0, 51.0, 41.0)
    mine, other = (paint(s, box, 0.01) for s in (read_gerber(path.read_text()).shapes, theirs))
    assert mine.sum() > 10_000
    assert np.count_nonzero(mine != other) < 0.002 * mine.sum()
