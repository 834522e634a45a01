"""Suites of sensors on grounds by rays: their decisions and costs."""
