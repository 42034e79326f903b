"""The paper's results compared with this project's: statements with verdicts, tables, figures, one page."""
