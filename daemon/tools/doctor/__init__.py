"""The examination of a station before its daemon runs; nothing here moves the head."""
