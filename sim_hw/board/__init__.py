"""Board on the bench, read from its Gerber files; and the maker of the demo board."""
