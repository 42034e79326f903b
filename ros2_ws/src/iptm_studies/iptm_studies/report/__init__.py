"""The reproduction of the paper as a page: tables, figures and a verdict per statement, from stored runs."""
