"""A rebuilt real scene: rocks on sand under one lamp, photographed by NASA Ames and scanned by others."""

#: The number of the method that compares POLAR. It was made on terrain 04 and is frozen: whoever changes it or one
#: of its constants makes another method.
METHOD = 3
