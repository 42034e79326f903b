"""The optimal control problem: stages, horizon-wide assembly, numerical data and compilation."""
