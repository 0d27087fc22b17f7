"""Scene before the camera: board, card, probe, light, sensor."""
