"""The default strategy behind measured lead vehicles, beside what the adaptive cruise controls there did."""
