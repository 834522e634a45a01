"""What scenes tell beyond themselves: typical scenes, means and shares with intervals that cover; only arrays."""
