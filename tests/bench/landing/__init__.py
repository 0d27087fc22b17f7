"""The landing campaigns: calibrated stations land and correct, judged by the truth alone."""
