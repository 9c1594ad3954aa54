"""Maps over power, detuning and whatever else is varied: by linear stability and by integration."""
