"""The machine over temperature: error maps, sensors, and what lies between the maps."""
