"""Ground below the probe, as the camera sees it: the board and the control-point card, each its own plane."""

import cv2
import numpy as np
import numpy.typing as npt

from sim_hw.board.board import ROBOT_ORIGIN_UM
from sim_hw.board.nest import InNest
from sim_hw.plant.card import CardPose
from sim_hw.scene.body import BodyArtist
from sim_hw.scene.card_print import CardPrint
from sim_hw.scene.empty_nest import EmptyNest
from sim_hw.scene.optics import HEIGHT_PX, WIDTH_PX, Matrix, Optics, Pose, Stand, board_plane
from sim_hw.scene.texture import BENCH_RED, BENCH_WHITE, BoardTexture, Image

_FRAME = np.array([[0, 0], [WIDTH_PX, 0], [WIDTH_PX, HEIGHT_PX], [0, HEIGHT_PX]], dtype=np.float64)
_BENCH = (*BENCH_WHITE, BENCH_RED)


class Ground:
    """Draw board, card and bench without probe and shadow. Not to be used by two threads at once."""

    def __init__(self, optics: Optics, nest: InNest, seed: int, tiles: int | None = None) -> None:
        self._optics = optics
        self._seed, self._tiles = seed, tiles
        self._empty: EmptyNest | None = None
        self._lay(nest)
        self._print = CardPrint(seed)
        self._print_to_mm = np.linalg.inv(self._print.from_mm())
        self._key: object = None
        self._seen: Image | None = None
        #: Where parts hide the needle in what was looked at last: (1200, 1600), 255 there; None for nowhere.
        self.front: Image | None = None

    def put(self, nest: InNest) -> None:
        """Draw another board from now on, or the same made otherwise."""
        if nest is not self._nest:
            self._lay(nest)
            self._key = None

    def _lay(self, nest: InNest) -> None:
        board = nest.board
        self._nest, self._board = nest, board
        self._texture = BoardTexture(board, self._seed, nest.finish, nest.marks, self._tiles)
        self._texel_to_mm = np.linalg.inv(self._texture.from_mm(board))
        self._bodies = BodyArtist(self._optics, board) if board.bodies else None

    def draw_ahead(self, stand: Stand | None = None, pose: Pose | None = None) -> bool:
        """Draw a little of what will be looked at, first from where the head is going; return False once it is done."""
        self._print.image(covered=False)
        if stand is None or pose is None:
            return self._texture.draw_one_more()
        return self._texture.draw_one_more(self._window(self.board_to_px(stand, pose) @ self._texel_to_mm))

    def board_to_px(self, stand: Stand, pose: Pose) -> Matrix:
        """Return the map (3, 3) from nominal board mm (u right, v up, from the outline's corner) to pixels."""
        return self._optics.homography(board_plane(ROBOT_ORIGIN_UM, self._board.size_mm, pose), stand)

    def card_to_px(self, stand: Stand, card: CardPose) -> Matrix:
        """Return the map (3, 3) from card mm (u right, v up, from its centre) to pixels."""
        return self._optics.homography(card.plane(), stand)

    def look(
        self, stand: Stand, pose: Pose, card: CardPose | None, *, covered: bool, gone: bool = False
    ) -> Image | None:
        """Return what is seen (1200, 1600, 4): BGR under the white lamp, red under the red one; None for bare bench.

        `card` is None where there is none; `gone` is an empty nest. What is returned is kept for the next look, which
        is the same under the other lamp as long as the head rests: it must not be changed.
        """
        key = (stand, pose, card, covered, gone, len(self._nest.marks))
        if key != self._key:
            self.front = None
            self._seen = self._nest_seen(stand, pose) if gone else self._board_seen(stand, pose)
            if self._bodies is not None and self._seen is not None and not gone:
                self.front = self._bodies.draw(self._seen, stand, pose)
            if card is not None:
                self._seen = self._with_card(self._seen, stand, card, covered=covered)
            self._key = key
        return self._seen

    def _board_seen(self, stand: Stand, pose: Pose) -> Image | None:
        to_px = self.board_to_px(stand, pose) @ self._texel_to_mm
        x0, y0, x1, y1 = self._window(to_px)
        if x1 - x0 < 4 or y1 - y0 < 4:
            return None
        self._texture.ensure(x0, y0, x1, y1)
        both = cv2.warpPerspective(
            self._texture.image[y0:y1, x0:x1],
            to_px @ _moved(x0, y0),
            (WIDTH_PX, HEIGHT_PX),
            flags=cv2.INTER_LINEAR,
            borderValue=_BENCH,
        )
        return np.asarray(both, dtype=np.uint8)

    def _window(self, to_px: Matrix) -> tuple[int, int, int, int]:
        """Return the texels x0, y0, x1, y1 that the frame shows."""
        seen = cv2.perspectiveTransform(_FRAME[None], np.linalg.inv(to_px))[0]
        x0, y0 = np.maximum(np.floor(seen.min(axis=0)).astype(int) - 2, 0)
        x1, y1 = np.minimum(np.ceil(seen.max(axis=0)).astype(int) + 3, (self._texture.width, self._texture.height))
        return int(x0), int(y0), int(x1), int(y1)

    def _nest_seen(self, stand: Stand, pose: Pose) -> Image:
        if self._empty is None:
            self._empty = EmptyNest(self._optics, self._seed)
        return self._empty.look(stand, pose, self._board)

    def _with_card(self, seen: Image | None, stand: Stand, card: CardPose, *, covered: bool) -> Image | None:
        """Lay the card on what is seen of the board, or on the bench."""
        to_px = self.card_to_px(stand, card) @ self._print_to_mm
        last = self._print.size - 1.0
        sheet = np.array([[0.0, 0.0], [last, 0.0], [last, last], [0.0, last]])
        corners = cv2.perspectiveTransform(sheet[None], to_px)[0]
        x0, y0 = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, (WIDTH_PX, HEIGHT_PX))
        if x1 <= x0 or y1 <= y0:
            return seen
        if seen is None:
            seen = np.full((HEIGHT_PX, WIDTH_PX, 4), _BENCH, dtype=np.uint8)
        region = np.ascontiguousarray(seen[y0:y1, x0:x1])
        cv2.warpPerspective(
            self._print.image(covered=covered),
            _moved(-x0, -y0) @ to_px,
            (int(x1 - x0), int(y1 - y0)),
            dst=region,
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
        seen[y0:y1, x0:x1] = region
        return seen


def _moved(x: float, y: float) -> npt.NDArray[np.float64]:
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
