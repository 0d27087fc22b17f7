"""The tables of the configuration file, one class each."""
