"""A real scene built again: rocks on sand under one lamp, which NASA Ames photographed and others measured."""

#: The number of the method that compares POLAR. It was made on terrain 04 and is frozen: whoever changes it or one
#: of its constants makes another method.
METHOD = 3
