"""The tables and figures of the GUISS paper, made again and shown beside the printed ones."""

#: The page with all results, in the output folder.
PAPER_PAGE = "paper.html"
#: The page and the tables beside it.
OUTPUT_FILES = (PAPER_PAGE, "results.csv", "results.tex", "runtimes.csv", "runtimes.tex")
