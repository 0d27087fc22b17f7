"""Board import: from a folder of CAD files to the board file of one side."""

from daemon.tools.board_import.build import AS_DELIVERED, Options, boards_of, import_board, import_boards
from daemon.tools.board_import.coverage import Coverage, net_coverage

__all__ = ["AS_DELIVERED", "Coverage", "Options", "boards_of", "import_board", "import_boards", "net_coverage"]
