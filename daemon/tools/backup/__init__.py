"""Backup of a station: configuration, calibrations, plans and journal in one archive, and putting it back."""

from daemon.tools.backup.archive import BackupError, Manifest, read_manifest
from daemon.tools.backup.collect import contents, make_backup
from daemon.tools.backup.restore import Restored, restore

__all__ = ["BackupError", "Manifest", "Restored", "contents", "make_backup", "read_manifest", "restore"]
