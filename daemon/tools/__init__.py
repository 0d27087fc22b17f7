"""Programs beside the daemon: reports, examination, demonstration, import of CAD, support bundle, installation."""
