"""A guard whose keys are taken back when a test says so."""

from daemon.server.auth import Authenticator


class RevokingGuard(Authenticator):
    """Counts a removal more for each that a test adds to `removed`."""

    removed = 0

    @property
    def removals(self) -> int:
        return self.removed
