"""Histories of a station, healthy and with one thing going wrong, and how maintenance does on them."""
