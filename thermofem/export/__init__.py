"""What exports of heat and of whole rings have in common: arguments, header, poles, RC networks, FMI units."""
