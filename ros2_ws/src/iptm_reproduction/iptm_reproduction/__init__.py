"""The paper's results beside this project's: statements with verdicts, tables and figures, from stored runs."""
