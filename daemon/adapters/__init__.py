"""Adapters for people who write tests: a pytest plugin and an OpenHTF plug, thin over the client."""
