"""Consilience: conclusions from independent multibody engines that agree are strong."""
