"""Physical models: terrain statistics, size laws, directions, sensors. numpy and float64 only, no Blender."""
