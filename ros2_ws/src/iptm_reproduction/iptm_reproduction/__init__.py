"""The paper's results beside this project's: statements with verdicts, tables, figures, one page."""
