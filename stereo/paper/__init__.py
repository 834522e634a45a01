"""The tables and figures of the GUISS paper, made again and beside the printed ones."""

#: The page with all of them, in the folder of the output.
PAGE = "paper.html"
