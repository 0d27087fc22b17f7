"""Images, edges, circles: what every search stands on."""
