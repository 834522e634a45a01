"""A real scene built again: rocks on sand under one lamp, which NASA Ames photographed and others measured."""
