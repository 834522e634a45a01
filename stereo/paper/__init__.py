"""The tables and figures of the GUISS paper, made again and beside the printed ones."""

#: The page with all of them, in the folder of the output.
PAGE = "paper.html"
#: The page and the tables beside it.
OUTPUT_FILES = (PAGE, "results.csv", "results.tex", "runtimes.csv", "runtimes.tex")
