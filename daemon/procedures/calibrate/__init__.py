"""The calibration jobs and what they leave behind; start at `jobs`."""
